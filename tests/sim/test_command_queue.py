"""Of many commands, the queue keeps those whose effect a person would see."""

from flexlab.presets import load_preset
from flexlab.sim.command_queue import MOST_STEPS, MOST_WAITING, CommandQueue, merged_changes
from flexlab.sim.commands import ChangeScenario, LoadScenario, Pause, Play, Pull, Reset, SetSpeed, StepOnce, Tap

PAPER, SOFT = LoadScenario(load_preset("paper"), "paper"), LoadScenario(load_preset("soft-beam"), "soft-beam")
TAP = Tap(0.0, (1.0, 0.0))


def change(**values) -> ChangeScenario:
    return ChangeScenario({path.replace("__", "."): value for path, value in values.items()})


def left_of(*commands) -> list:
    """The groups of commands that the runner would take."""
    queue = CommandQueue()
    for command in commands:
        queue.put(command)
    return queue.take()


def test_only_the_last_value_of_each_field_remains():
    """Two people drag two sliders: the last value of each remains."""
    drag = [change(gravity=float(k)) for k in range(500)]
    other = [change(payload__bending_stiffness=100.0 + k) for k in range(500)]
    (group,) = left_of(*(one for pair in zip(drag, other, strict=True) for one in pair))
    assert merged_changes(one.changes for one in group) == {"gravity": 499.0, "payload.bending_stiffness": 599.0}
    assert len(group) == 2


def test_a_change_of_a_whole_part_supersedes_changes_of_its_fields_but_not_vice_versa():
    whole, field = change(trajectory={"kind": "sine"}), change(trajectory__phase=(0.1, 0.1, 0.1))
    assert left_of(field, whole) == [(whole,)]
    assert left_of(whole, field) == [(whole, field)]


def test_merged_changes_are_in_the_order_of_their_last_values():
    """A change of kind resets an earlier gain; a later gain stays."""
    first, second = {"controller.kind": "pd", "controller.position_gain": 5.0}, {"controller.kind": "computed-torque"}
    assert list(merged_changes([first, second])) == ["controller.position_gain", "controller.kind"]
    assert list(merged_changes([second, first])) == ["controller.kind", "controller.position_gain"]


def test_only_the_last_of_many_presets_is_loaded():
    """Commands to the runs that never began are dropped with them; commands to the clock stay."""
    storm = [command for k in range(300) for command in (PAPER, change(gravity=float(k)), TAP, StepOnce(5), SOFT)]
    assert left_of(SetSpeed(0.5), *storm, Play()) == [(SetSpeed(0.5),), (SOFT,), (Play(),)]


def test_one_of_many_resets_remains_and_with_it_the_last_change():
    storm = [command for k in range(1000) for command in (change(gravity=k / 100), TAP, Reset())]
    assert left_of(*storm) == [(change(gravity=9.99),), (Reset(),)]


def test_changes_and_a_reset_after_a_load_become_a_load_of_the_changed_scenario():
    ((load,),) = left_of(PAPER, change(gravity=9.81), Reset())
    assert load == LoadScenario(PAPER.scenario.replace({"gravity": 9.81}), "paper")


def test_only_the_last_of_play_and_pause_speeds_and_pulls_remains_and_steps_add_up():
    """Steps add up to no more than one command may ask for."""
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


def test_changes_are_not_merged_across_a_new_run_or_steps():
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


def test_commands_that_begin_a_run_can_be_left_waiting():
    """Later commands wait with them."""
    queue = CommandQueue()
    for command in (TAP, change(payload__element_count=4), change(gravity=1.0)):
        queue.put(command)
    assert queue.take(new_runs=False) == [(TAP,)]
    assert queue.take(new_runs=False) == []
    queue.put(change(payload__element_count=5))
    assert queue.take(new_runs=False) == [(change(gravity=1.0),)], "what it waited for has been superseded"
    assert queue.take() == [(change(payload__element_count=5),)]


def test_commands_that_are_put_back_come_first():
    queue = CommandQueue()
    queue.put(change(gravity=1.0))
    groups = queue.take()
    queue.put(change(gravity=2.0))
    queue.put(TAP)
    queue.put_back([*groups, (Play(),)])
    assert queue.take() == [(Play(),), (change(gravity=2.0),), (TAP,)]
