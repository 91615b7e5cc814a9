"""A few of the random scenarios; `random_scenarios` itself judges as many as one has time for."""

import pytest
from random_scenarios import judge


@pytest.mark.parametrize("seed", [1, 3, 5, 7])
def test_a_random_scenario_is_right_or_called_inaccurate(seed: int):
    judged = judge(seed)
    assert not judged.complaints, judged.text
