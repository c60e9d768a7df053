from salpchain.training.run_log import Recent


def rollout(episodes, success):
    return {"episodes": float(episodes), "success": success, "closed_fraction": success}


def test_success_is_that_of_the_latest_200_episodes():
    recent = Recent()
    for success in (0.0, 0.5, 1.0):
        recent.add(rollout(120, success))
    assert recent.means() == (0.75, 0.75)


def test_the_first_few_episodes_are_not_yet_a_success_rate():
    """The first to end are those that started beside their target."""
    recent = Recent()
    recent.add(rollout(199, 1.0))
    assert not recent.whole
    recent.add(rollout(1, 1.0))
    assert recent.whole


def test_before_any_episode_has_ended_there_is_no_rate():
    recent = Recent()
    recent.add(rollout(0, float("nan")))
    assert recent.means() == (None, None)
