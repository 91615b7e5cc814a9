"""Of many commands, those remain whose effect a person would see."""

from flexlab.presets import load_preset
from flexlab.sim.command_queue import MOST_STEPS, MOST_WAITING, CommandQueue, merged_changes
from flexlab.sim.commands import ChangeScenario, LoadScenario, Pause, Play, Pull, Reset, SetSpeed, StepOnce, Tap

PAPER, SOFT = LoadScenario(load_preset("paper"), "paper"), LoadScenario(load_preset("soft-beam"), "soft-beam")
TAP = Tap(0.0, (1.0, 0.0))


def change(**values) -> ChangeScenario:
    return ChangeScenario({path.replace("__", "."): value for path, value in values.items()})


def left_of(*commands) -> list:
    """The groups that the runner would take."""
    queue = CommandQueue()
    for command in commands:
        queue.put(command)
    return queue.take()


def test_the_last_value_of_a_field_counts():
    """Two people drag two sliders: one change with the last values of both remains."""
    drag = [change(gravity=float(k)) for k in range(500)]
    other = [change(payload__bending_stiffness=100.0 + k) for k in range(500)]
    (group,) = left_of(*(one for pair in zip(drag, other, strict=True) for one in pair))
    assert merged_changes(one.changes for one in group) == {"gravity": 499.0, "payload.bending_stiffness": 599.0}
    assert len(group) == 2


def test_a_whole_part_supersedes_its_fields_but_not_the_other_way_round():
    whole, field = change(trajectory={"kind": "sine"}), change(trajectory__phase=(0.1, 0.1, 0.1))
    assert left_of(field, whole) == [(whole,)]
    assert left_of(whole, field) == [(whole, field)]


def test_merged_changes_are_in_the_order_of_their_last_values():
    """A change of kind resets an earlier gain; a later gain stays."""
    first, second = {"controller.kind": "pd", "controller.position_gain": 5.0}, {"controller.kind": "computed-torque"}
    assert list(merged_changes([first, second])) == ["controller.position_gain", "controller.kind"]
    assert list(merged_changes([second, first])) == ["controller.kind", "controller.position_gain"]


def test_of_many_presets_the_last_one_is_loaded():
    """Commands to the runs that never began are dropped with them; commands to the clock stay."""
    storm = [command for k in range(300) for command in (PAPER, change(gravity=float(k)), TAP, StepOnce(5), SOFT)]
    assert left_of(SetSpeed(0.5), *storm, Play()) == [(SetSpeed(0.5),), (SOFT,), (Play(),)]


def test_of_many_resets_one_is_left_and_the_changes_with_it():
    storm = [command for k in range(1000) for command in (change(gravity=k / 100), TAP, Reset())]
    assert left_of(*storm) == [(change(gravity=9.99),), (Reset(),)]


def test_a_run_that_has_not_begun_begins_changed_instead_of_being_reset():
    ((load,),) = left_of(PAPER, change(gravity=9.81), Reset())
    assert load == LoadScenario(PAPER.scenario.replace({"gravity": 9.81}), "paper")


def test_clock_and_hand():
    """The last of play and pause, of speeds and of pulls remains; steps add up to the most that one command may ask for."""
    pulls = [Pull(0.0, (0.0, k / 100), 100.0) for k in range(50)]
    assert left_of(Play(), Pause(), SetSpeed(1.0), *pulls, SetSpeed(0.5), Play()) == [
        (pulls[-1],),
        (SetSpeed(0.5),),
        (Play(),),
    ]
    assert left_of(StepOnce(1), StepOnce(2), change(gravity=1.0), StepOnce(3)) == [
        (StepOnce(3),),
        (change(gravity=1.0),),
        (StepOnce(3),),
    ]
    assert left_of(StepOnce(MOST_STEPS), StepOnce(1)) == [(StepOnce(MOST_STEPS),), (StepOnce(1),)]


def test_changes_stay_on_their_side_of_a_new_run_and_of_steps():
    before, after = change(gravity=1.0), change(gravity=2.0)
    assert left_of(before, Reset(), after) == [(before,), (Reset(),), (after,)]
    assert left_of(before, StepOnce(1), after) == [(before,), (StepOnce(1),), (after,)]
    assert left_of(before, PAPER, after) == [(PAPER,), (after,)]


def test_the_queue_is_bounded_and_counts_what_it_refused():
    queue = CommandQueue()
    for _ in range(5000):
        queue.put(TAP)
    assert len(queue.take()) == MOST_WAITING
    assert queue.refused() == 5000 - MOST_WAITING
    assert queue.refused() == 0


def test_what_begins_a_run_can_be_left_waiting():
    """Commands after it wait with it."""
    queue = CommandQueue()
    for command in (TAP, change(payload__element_count=4), change(gravity=1.0)):
        queue.put(command)
    assert queue.take(new_runs=False) == [(TAP,)]
    assert queue.take(new_runs=False) == []
    queue.put(change(payload__element_count=5))
    assert queue.take(new_runs=False) == [(change(gravity=1.0),)], "what it waited for has been superseded"
    assert queue.take() == [(change(payload__element_count=5),)]


def test_what_is_put_back_stands_first():
    queue = CommandQueue()
    queue.put(change(gravity=1.0))
    groups = queue.take()
    queue.put(change(gravity=2.0))
    queue.put(TAP)
    queue.put_back([*groups, (Play(),)])
    assert queue.take() == [(Play(),), (change(gravity=2.0),), (TAP,)]
