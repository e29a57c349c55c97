import pytest

from physid.training.learners.phases import Phase, Phases


def test_the_phases_follow_each_other() -> None:
    phases = Phases(warm_up=2, refine=1)
    assert [phases.at(epoch, 5) for epoch in range(5)] == [Phase.WARM_UP] * 2 + [Phase.JOINT] * 2 + [Phase.REFINE]


def test_the_encoder_learns_slowly_at_both_ends_and_fastest_in_between() -> None:
    phases = Phases(warm_up=8, refine=2, rise=0.2)
    rates = [phases.encoder_share(done, 12) for done in (0.0, 2.0, 10.0)]
    assert rates == pytest.approx([phases.lowest, 1.0, phases.lowest])


def test_the_parameters_rest_while_the_encoder_warms_up() -> None:
    assert Phases(warm_up=3, refine=1).parameter_share(2.9, 8) == 0.0


def test_phases_longer_than_the_run_are_refused() -> None:
    with pytest.raises(ValueError, match="max_epochs must be at least 13"):
        Phases(warm_up=10, refine=3).check(12)
