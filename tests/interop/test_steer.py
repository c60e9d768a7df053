import numpy as np
import pytest

from salpchain.controllers.greedy import Greedy
from salpchain.errors import InputError
from salpchain.interop.steer import steering
from tests.interop.policies import fresh
from tests.interop.test_onnx import actions, observed


def test_it_acts_as_the_policy_does_with_a_batch_and_without():
    policy = fresh()
    steer, obs = steering(policy, length=5), observed(3, 5)
    np.testing.assert_allclose(steer(obs), actions(policy, obs), atol=1e-6)
    np.testing.assert_allclose(steer(obs[0]), steer(obs)[0], atol=1e-6)


@pytest.mark.parametrize(
    ("policy", "task", "word"),
    [
        (fresh(), {"observation": "table1"}, "'body', the environment 'table1'"),
        (fresh(action="pair"), {}, "make it with action='pair'"),
        (fresh("mlp", length=3), {"length": 4}, "3 units only, got length 4"),
    ],
)
def test_a_policy_that_does_not_fit_the_environment_is_refused(policy, task, word):
    with pytest.raises(InputError, match=word):
        steering(policy, **task)


def test_only_a_learned_policy_maps_observations():
    with pytest.raises(InputError, match="takes a learned policy"):
        steering(Greedy(), length=3)


@pytest.mark.parametrize("shape", [(3, 22), (5, 21), (22,), (0, 5, 21)])
def test_observations_of_another_shape_are_refused(shape):
    with pytest.raises(InputError, match=r"must have shape \(\.\.\., 5, 22\)"):
        steering(fresh(), length=5)(np.zeros(shape))
