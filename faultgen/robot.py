"""A robot is one MJCF file; this module reads from it what the rest needs to know.

By name in the file: arm joints ``joint1``..., rotor joints ``motor1``..., gearboxes ``gearbox1``...
(fixed tendons of length q_motor / n - q_joint), servo drives ``drive1``... and friction
``friction1``... (passive dcmotors). Limits that MJCF has no attribute for are ``numeric`` elements.

    robot = load_robot("puma560")
    robot.n_axes, robot.gear_ratio, robot.model.opt.timestep
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from importlib import resources
from pathlib import Path

import mujoco
import numpy as np

from faultgen.errors import InputError

# dcmotor parameters in MuJoCo's parameter arrays (mjModel.actuator_biasprm, actuator_dynprm)
OFFSET, COULOMB, STICTION, STRIBECK_VELOCITY = 0, 3, 4, 5  # in biasprm
BRISTLE_STIFFNESS, BRISTLE_DAMPING = 5, 6  # in dynprm


@dataclass(frozen=True)
class Robot:
    """A robot model and the numbers that were read from it. Axis arrays have shape (n_axes,)."""

    name: str
    """Name in datasets: the folder's name for a robot of ours, else the file's stem."""
    xml: str
    """The MJCF text."""
    n_axes: int = field(init=False)
    """Number of axes."""
    joints: tuple[int, ...] = field(init=False)
    """Degree-of-freedom index of each arm joint."""
    motors: tuple[int, ...] = field(init=False)
    """Degree-of-freedom index of each rotor."""
    gear_ratio: np.ndarray = field(init=False)
    """Rotor turns per joint turn, signed."""
    joint_range: np.ndarray = field(init=False)
    """Shape (n_axes, 2), in [rad]."""
    motor_velocity_limit: np.ndarray = field(init=False)
    """In [rad/s]."""
    motor_torque_limit: np.ndarray = field(init=False)
    """In [N m]."""
    joint_acceleration_limit: np.ndarray = field(init=False)
    """Largest acceleration that motions are planned with, joint side, in [rad/s^2]."""
    encoder_counts: np.ndarray = field(init=False)
    """Encoder counts a motor turn; 0 means no quantisation."""
    set_points: np.ndarray = field(init=False)
    """Share of the set points that the controller commands: position, velocity, feed-forward."""
    torque_gain: np.ndarray = field(init=False)
    """Torque that the motors give, over the logged one; 1 unless a calibration found another."""
    friction_temperature: float = field(init=False)
    """Temperature at which the friction parameters hold, in [deg C]."""

    def __post_init__(self) -> None:
        model = self.model
        n = 0
        while mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"joint{n + 1}") >= 0:
            n += 1
        if n == 0:
            raise InputError(f"robot {self.name}: no joint named 'joint1'; see docs/robots.md")
        put = object.__setattr__
        put(self, "n_axes", n)
        joints = [_id(self.name, model, "joint", f"joint{i + 1}") for i in range(n)]
        motors = [_id(self.name, model, "joint", f"motor{i + 1}") for i in range(n)]
        put(self, "joints", tuple(int(model.jnt_dofadr[j]) for j in joints))
        put(self, "motors", tuple(int(model.jnt_dofadr[j]) for j in motors))
        put(self, "joint_range", model.jnt_range[joints].copy())
        put(self, "gear_ratio", np.array([self._gear_ratio(model, i) for i in range(n)]))
        drives = [_id(self.name, model, "actuator", f"drive{i + 1}") for i in range(n)]
        for i in range(n):
            _id(self.name, model, "actuator", f"friction{i + 1}")
        limited = model.actuator_forcelimited[drives]
        put(
            self,
            "motor_torque_limit",
            np.where(limited, model.actuator_forcerange[drives, 1], np.inf),
        )
        put(self, "motor_velocity_limit", self._numeric(model, "motor_velocity_limit", np.inf))
        put(self, "joint_acceleration_limit", self._numeric(model, "joint_acceleration_limit", 5.0))
        put(self, "encoder_counts", self._numeric(model, "encoder_counts", 0.0))
        put(self, "set_points", self._numeric(model, "servo_set_points", 1.0, 3))
        put(self, "torque_gain", self._numeric(model, "torque_gain", 1.0))
        put(
            self,
            "friction_temperature",
            float(self._numeric(model, "friction_temperature", 40.0, 1)[0]),
        )

    def spec(self) -> mujoco.MjSpec:
        """A fresh, editable copy of the model."""
        return mujoco.MjSpec.from_string(self.xml)

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The healthy robot, compiled. Not to be edited."""
        try:
            return self.spec().compile()
        except ValueError as error:
            line = " ".join(str(error).split())
            raise InputError(f"robot {self.name}: MuJoCo cannot read the model: {line}") from None

    @cached_property
    def sha256(self) -> str:
        """Hash of the MJCF text."""
        return hashlib.sha256(self.xml.encode()).hexdigest()

    def ids(self, kind: str, name: str, model: mujoco.MjModel | None = None) -> np.ndarray:
        """Ids of the elements ``name1`` ... ``name{n_axes}``, in the robot or an edit of it.

        Args:
            kind: 'actuator', 'tendon' or 'joint'.
            name: Name without the number of the axis.
            model: Where the ids hold; default: the healthy robot.
        """
        where = self.model if model is None else model
        return np.array([_id(self.name, where, kind, f"{name}{i + 1}") for i in range(self.n_axes)])

    def addresses(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Where the rotors and the arm's joints are in qpos and qvel of an edit of the robot.

        `motors` and `joints` are those of the healthy one.
        """
        motors, joints = (
            model.jnt_dofadr[self.ids("joint", name, model)] for name in ("motor", "joint")
        )
        return motors, joints

    def _gear_ratio(self, model: mujoco.MjModel, axis: int) -> float:
        tendon = _id(self.name, model, "tendon", f"gearbox{axis + 1}")
        start = model.tendon_adr[tendon]
        wraps = range(start, start + model.tendon_num[tendon])
        coefficient = {int(model.jnt_dofadr[model.wrap_objid[w]]): model.wrap_prm[w] for w in wraps}
        motor, joint = coefficient.get(self.motors[axis]), coefficient.get(self.joints[axis])
        if not motor or joint != -1.0:
            raise InputError(
                f"robot {self.name}: tendon 'gearbox{axis + 1}' must have coef 1/n on "
                f"motor{axis + 1} and -1 on joint{axis + 1}"
            )
        return 1.0 / motor

    def _numeric(
        self, model: mujoco.MjModel, name: str, default: float, size: int | None = None
    ) -> np.ndarray:
        size = size or self.n_axes
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
        if index < 0:
            return np.full(size, default)
        start = model.numeric_adr[index]
        values = model.numeric_data[start : start + model.numeric_size[index]].copy()
        if len(values) != size:
            raise InputError(
                f"robot {self.name}: numeric '{name}' has {len(values)} values, not {size}"
            )
        return values


def robot_names() -> list[str]:
    """Names of the robots that come with the package."""
    folder = resources.files("robots")
    return sorted(f.name for f in folder.iterdir() if f.joinpath(f"{f.name}.xml").is_file())


def load_robot(name_or_path: str | Path) -> Robot:
    """Load a robot by its name or from an MJCF file.

    Args:
        name_or_path: One of `robot_names`, or the path of an MJCF file with the names above.

    Returns:
        The robot.

    Raises:
        InputError: There is no such robot, or the file lacks an element that a robot needs.
    """
    name = str(name_or_path)
    if name in robot_names():
        text = resources.files("robots").joinpath(name, f"{name}.xml").read_text()
        return Robot(name, text)
    path = Path(name_or_path)
    if not path.is_file():
        known = ", ".join(robot_names())
        raise InputError(f"unknown robot '{name}': choose {known}, or give the path of an MJCF")
    try:
        return Robot(path.stem, path.read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"robot file {path}: cannot be read as text ({error})") from None


def _id(robot: str, model: mujoco.MjModel, kind: str, name: str) -> int:
    types = {
        "joint": mujoco.mjtObj.mjOBJ_JOINT,
        "tendon": mujoco.mjtObj.mjOBJ_TENDON,
        "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
    }
    index = mujoco.mj_name2id(model, types[kind], name)
    if index < 0:
        raise InputError(f"robot {robot}: no {kind} named '{name}'")
    return index
