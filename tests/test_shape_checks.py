"""The tests' own ground: annotations are really checked, and cover every module that can be."""

import numpy as np
import pytest
from jaxtyping import TypeCheckError

from conftest import checked_modules
from poseloom.skeleton.body import average_body
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.skeleton.skeleton import Skeleton


def test_a_wrong_shape_is_refused():
    with pytest.raises(TypeCheckError):
        forward_kinematics(average_body(), np.zeros((2, 69)))


def test_a_wrong_type_of_number_is_refused():
    with pytest.raises(TypeCheckError):
        forward_kinematics(average_body(), np.zeros(69, dtype=np.float32))


def test_a_wrong_shape_in_a_dataclass_is_refused():
    body = average_body()
    with pytest.raises(TypeCheckError):
        Skeleton(body.names, body.parents, body.offsets[:, :2], body.tips, body.locked)


def test_every_module_but_kernels_is_checked():
    modules = checked_modules()
    assert "poseloom.skeleton.kinematics" in modules
    assert not [name for name in modules if name.endswith("_kernels")]
