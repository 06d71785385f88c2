"""The resonances that the README of the PUMA 560 states, from the model itself."""

import mujoco
import numpy as np
from scipy.linalg import eigh

from faultgen.robot import load_robot


def test_resonances_of_the_zero_pose():
    """Rotors held: each axis by itself, and the lowest modes of the whole arm, to 0.05 Hz."""
    robot = load_robot("puma560")
    model = robot.model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    joints = [model.jnt_dofadr[model.joint(f"joint{axis}").id] for axis in range(1, 7)]
    inertia = inertia[np.ix_(joints, joints)]
    gearboxes = [model.tendon(f"gearbox{axis}").id for axis in range(1, 7)]
    stiffness = np.reshape(model.tendon_stiffness[gearboxes], (6, -1))[:, 0]
    assert not data.qpos.any()
    by_axis = np.sqrt(stiffness / np.diag(inertia)) / (2 * np.pi)
    np.testing.assert_allclose(by_axis[:3], [18.9, 26.4, 28.1], atol=0.05)
    modes = np.sqrt(eigh(np.diag(stiffness), inertia, eigvals_only=True)) / (2 * np.pi)
    np.testing.assert_allclose(modes[:3], [18.3, 21.8, 39.1], atol=0.05)
