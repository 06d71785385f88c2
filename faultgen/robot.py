"""Robots. A robot is one MJCF file; this module reads from it what the other modules need.

The elements of the file are found by their names. Arm joints are ``joint1``, ``joint2``, ...; rotor
joints are ``motor1``, ...; gearboxes are ``gearbox1``, ... (fixed tendons of length
q_motor / n - q_joint); servo drives are ``drive1``, ...; and friction elements are ``friction1``,
... (passive dcmotors). Limits for which MJCF has no attribute are ``numeric`` elements.

A robot can also be a folder that holds, besides the MJCF file, effects that MJCF cannot express.
These effects belong to the healthy robot: every simulation has them, and the severity of a fault
counts from there.

    robot = load_robot("puma560")
    robot.n_axes, robot.gear_ratio, robot.model.opt.timestep
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from importlib import resources
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from faultgen.applied import Applied, to_json
from faultgen.errors import InputError, one_line
from faultgen.mjcf.checks import count_axes, missing_elements, wrong_elements, wrong_numbers
from faultgen.mjcf.compiling import read_mjcf
from faultgen.mjcf.dcmotor import BRISTLE_DAMPING as BRISTLE_DAMPING
from faultgen.mjcf.dcmotor import BRISTLE_STIFFNESS as BRISTLE_STIFFNESS
from faultgen.mjcf.dcmotor import COULOMB as COULOMB
from faultgen.mjcf.dcmotor import OFFSET as OFFSET
from faultgen.mjcf.dcmotor import STICTION as STICTION
from faultgen.mjcf.dcmotor import STRIBECK_VELOCITY as STRIBECK_VELOCITY
from faultgen.mjcf.edit import forget_defaults, mjcf_text, resolve_inertias
from faultgen.mjcf.elements import element_ids, stated_name
from faultgen.mjcf.folder import read_folder, write_folder
from faultgen.mjcf.gearing import Gearing, tendon_coefficients
from faultgen.mjcf.memory import check_memory
from faultgen.mjcf.rotors import COUPLING as COUPLING
from faultgen.mjcf.warnings import mujoco_warnings
from faultgen.robot_names import check_robot
from faultgen.robot_names import robot_names as robot_names

_ROUNDING = 1e-9  # by which a joint may be outside its range [rad or m]


@dataclass(frozen=True, repr=False)
class Robot:
    """A robot model and the numbers that were read from it.

    Arrays have shape (n_axes,) unless stated otherwise.
    """

    name: str
    """Name in datasets: for a robot that comes with faultgen its own name, else the name of the
    file without its ending."""
    xml: str
    """The MJCF text."""
    assets: Mapping[str, bytes] = field(default_factory=dict, repr=False)
    """Content of the files that the text refers to, such as meshes, by name."""
    effects: tuple[Applied, ...] = ()
    """Effects of the healthy robot that MJCF cannot express. `plant.assemble` puts them into every
    machine, before all others."""
    tasks: Mapping[str, str] = field(default_factory=dict, repr=False, compare=False)
    """Text of the task files in the robot's folder, by name of the task."""
    origin: Mapping[str, str] = field(default_factory=dict, repr=False, compare=False)
    """Text of the user's MJCF or URDF file from which `robot build` made the robot, by its name;
    empty if there is none."""
    n_axes: int = field(init=False)
    """Number of axes."""
    joints: tuple[int, ...] = field(init=False)
    """Degree-of-freedom index of each arm joint."""
    motors: tuple[int, ...] = field(init=False)
    """Degree-of-freedom index of each rotor."""
    gear_ratio: np.ndarray = field(init=False)
    """Rotor turns per joint turn, with sign; [rad/m] where the joint slides."""
    slides: np.ndarray = field(init=False)
    """Whether the arm joint slides instead of turning."""
    payload_mass: float = field(init=False)
    """Mass of the body ``payload`` [kg]; nan if there is none."""
    joint_range: np.ndarray = field(init=False)
    """Lower and upper joint angle, shape (n_axes, 2), in [rad]; infinite where there is no
    limit."""
    motor_velocity_limit: np.ndarray = field(init=False)
    """Largest motor speed [rad/s]."""
    motor_torque_limit: np.ndarray = field(init=False)
    """Largest motor torque [N m]."""
    joint_acceleration_limit: np.ndarray = field(init=False)
    """Largest joint acceleration in planned motions [rad/s^2]."""
    encoder_counts: np.ndarray = field(init=False)
    """Encoder counts per motor turn; 0 means no quantisation."""
    set_points: np.ndarray = field(init=False)
    """Factors of what the controller commands, shape (3,): position, velocity and feed-forward
    torque. A factor of 1 means that it is commanded in full."""
    servo_friction: np.ndarray = field(init=False)
    """Which friction the feed-forward torque contains, shape (2,): the share of the model's
    friction, and the speed over which its step at zero speed is smoothed, over the Stribeck
    velocity."""
    torque_gain: np.ndarray = field(init=False)
    """Torque of the motors divided by the torque that their drives log; 1 unless a calibration
    found another value."""
    friction_temperature: float = field(init=False)
    """Temperature at which the friction parameters hold, in [deg C]."""

    def __repr__(self) -> str:
        effects = ", ".join(f"{one.effect} of axis {one.axis}" for one in self.effects)
        with_effects = f", with {effects}" if effects else ""
        return f"Robot('{self.name}', {self.n_axes} axes{with_effects})"

    def _repr_html_(self) -> str:
        """A table of the axes, which notebooks show."""
        from tabulate import tabulate

        kinds = np.where(self.slides, "slide", "hinge")
        numbers = (self.gear_ratio, *self.joint_range.T, self.motor_velocity_limit)
        columns = (range(1, self.n_axes + 1), kinds, *numbers, self.motor_torque_limit)
        head = ("axis", "joint", "gear ratio", "from [rad, m]", "to", "speed [rad/s]", "[N m]")
        rows = list(zip(*columns, strict=True))
        return f"<p>{escape(repr(self))}</p>{tabulate(rows, head, 'html', floatfmt='.4g')}"

    def __post_init__(self) -> None:
        model = self.model
        n = count_axes(model)
        if n == 0:
            raise InputError(f"robot {self.name}: no joint named 'joint1'; see docs/robots.md")
        self._refuse(missing_elements(model, n))
        put = object.__setattr__
        put(self, "n_axes", n)
        joints, motors = self.ids("joint", "joint"), self.ids("joint", "motor")
        put(self, "joints", tuple(model.jnt_dofadr[joints].tolist()))
        put(self, "motors", tuple(model.jnt_dofadr[motors].tolist()))
        limited = model.jnt_limited[joints].astype(bool)[:, None]
        put(self, "joint_range", np.where(limited, model.jnt_range[joints], [-np.inf, np.inf]))
        put(self, "slides", model.jnt_type[joints] == int(mujoco.mjtJoint.mjJNT_SLIDE))
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "payload")
        put(self, "payload_mass", float(model.body_mass[body]) if body >= 0 else float("nan"))
        drives = self.ids("actuator", "drive")
        limited = model.actuator_forcelimited[drives]
        limit = np.where(limited, model.actuator_forcerange[drives, 1], np.inf)
        put(self, "motor_torque_limit", limit)
        findings = wrong_elements(model, n)
        ratio = np.array([self._gear_ratio(model, axis, findings) for axis in range(n)])
        put(self, "gear_ratio", ratio)
        numerics = {
            name: self._numeric(model, name, default, size, findings)
            for name, default, size in (
                ("motor_velocity_limit", np.inf, n),
                ("joint_acceleration_limit", 5.0, n),
                ("encoder_counts", 0.0, n),
                ("servo_set_points", 1.0, 3),
                ("servo_friction", 1.0, 2),
                ("torque_gain", 1.0, n),
                ("friction_temperature", 40.0, 1),
            )
        }
        self._refuse([*findings, *wrong_numbers(model, self.xml, n, numerics)])
        put(self, "set_points", numerics.pop("servo_set_points"))
        put(self, "servo_friction", numerics.pop("servo_friction"))
        put(self, "friction_temperature", float(numerics.pop("friction_temperature")[0]))
        for name, values in numerics.items():
            put(self, name, values)

    def _refuse(self, findings: list[str]) -> None:
        if findings:
            raise InputError(f"robot {self.name}: {'; '.join(findings)} (see docs/robots.md)")

    def spec(self) -> mujoco.MjSpec:
        """A fresh, editable copy of the model, in which every inertia is diagonal."""
        spec = mujoco.MjSpec.from_string(self.xml, assets=dict(self.assets))
        resolve_inertias(spec)
        forget_defaults(spec)
        return spec

    @property
    def joint_velocity_limit(self) -> np.ndarray:
        """Largest speed of the joints that the motors allow, shape (n_axes,), in [rad/s]."""
        return np.asarray(self.motor_velocity_limit / np.abs(self.gear_ratio))

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled model of the healthy robot. It must not be changed."""
        with mujoco_warnings() as warned:
            try:
                model = self.spec().compile()
            except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
                line = one_line(error) or "not enough memory"
                raise InputError(
                    f"robot {self.name}: MuJoCo cannot read the model: {line}"
                ) from None
        if any("NaN" in message for message in warned):
            raise InputError(f"robot {self.name}: an attribute of the model is NaN, not a number")
        return model

    @cached_property
    def gearing(self) -> Gearing:
        """How the motors turn with the joints."""
        tendons, ratio = self.ids("tendon", "gearbox"), self.gear_ratio
        motors, joints = np.array(self.motors), np.array(self.joints)
        return Gearing(self.model, tendons, motors, joints, ratio)

    @cached_property
    def stribeck_velocity(self) -> np.ndarray:
        """Motor speed over which friction falls from stiction to Coulomb friction.

        Shape (n_axes,), in [rad/s].
        """
        return self.model.actuator_biasprm[self.ids("actuator", "friction"), STRIBECK_VELOCITY]

    @cached_property
    def sha256(self) -> str:
        """Hash of the MJCF text, of the files that it refers to, and of the effects beside it."""
        digest = hashlib.sha256(self.xml.encode())
        for name, content in sorted(self.assets.items()):
            digest.update(f"{name} {len(content)}\n".encode() + content)
        if self.effects:
            digest.update(json.dumps(to_json(self.effects), sort_keys=True).encode())
        return digest.hexdigest()

    def edited(self, spec: mujoco.MjSpec) -> Robot:
        """Return a robot with the same name, files, effects and tasks and with another model.

        Args:
            spec: The other model, compiled.
        """
        return replace(self, xml=mjcf_text(spec))

    def with_effects(self, effects: Sequence[Applied]) -> Robot:
        """Return the same robot with further effects that MJCF cannot express.

        Args:
            effects: Effects that act after those that the robot has. A second severity of the same
                effect acts on the robot that already has the first one.
        """
        return replace(self, effects=(*self.effects, *effects))

    def write(self, folder: Path) -> None:
        """Write the robot into a folder that `load_robot` reads.

        Args:
            folder: The folder. It is created if it does not exist.
        """
        write_folder(
            folder, self.name, self.xml, self.assets, self.effects, self.tasks, self.origin
        )

    def label(self, element: str, axis: int) -> str:
        """Name an element of an axis in a message.

        Args:
            element: Its name without the number of the axis, such as "axis " or "friction".
            axis: Axis, from 1.

        Returns:
            For example "axis 2", or "axis 2 (elbow)" if the model states how the file from which it
            was built names the joint.
        """
        name = stated_name(self.model, axis)
        return f"{element}{axis} ({name})" if name else f"{element}{axis}"

    def out_of_range(self, joints: np.ndarray) -> list[str]:
        """Describe the joints that are outside their range.

        Args:
            joints: Shape (n_axes,), in [rad], or [m] where the joint slides.

        Returns:
            One line for each such joint. Rounding counts as inside.
        """
        low, high = self.joint_range.T
        values, first, last = (self.to_degrees(one) for one in (joints, low, high))
        return [
            f"{self.label('axis ', k + 1)} at {values[k]:.4g} is outside its range of "
            f"{first[k]:.4g} to {last[k]:.4g} {'m' if self.slides[k] else 'deg'}"
            for k in np.flatnonzero(
                (joints < low - _ROUNDING) | (joints > high + _ROUNDING)
            ).tolist()
        ]

    def to_degrees(self, joints: np.ndarray) -> np.ndarray:
        """Convert joint positions to the units of task files.

        Args:
            joints: Shape (..., n_axes), in [rad], or [m] where the joint slides.

        Returns:
            The same in [deg], or [m] where the joint slides, same shape.
        """
        return np.where(self.slides, joints, np.degrees(joints))

    def from_degrees(self, joints: ArrayLike) -> np.ndarray:
        """Convert joint positions from the units of task files.

        Args:
            joints: Shape (..., n_axes), in [deg], or [m] where the joint slides.

        Returns:
            The same in [rad], or [m] where the joint slides, same shape.
        """
        return np.where(self.slides, joints, np.radians(joints))

    def ids(self, kind: str, name: str, model: mujoco.MjModel | None = None) -> np.ndarray:
        """Find the ids of the elements ``name1`` ... ``name{n_axes}``.

        Args:
            kind: 'actuator', 'tendon' or 'joint'.
            name: Name of the elements without the number of the axis.
            model: Model in which the ids are valid. Default: that of the healthy robot.

        Returns:
            Ids, shape (n_axes,).

        Raises:
            InputError: The model lacks one of the elements.
        """
        where = self.model if model is None else model
        try:
            return element_ids(where, kind, name, self.n_axes)
        except InputError as error:
            raise InputError(f"robot {self.name}: {error}") from None

    def addresses(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Find the indices of the rotors and of the arm joints in qpos and qvel of a model.

        The fields `motors` and `joints` hold the indices in the model of the healthy robot.

        Args:
            model: A model compiled from an edit of the robot.

        Returns:
            Indices of the rotors and of the arm joints, each of shape (n_axes,).
        """
        motors, joints = (
            model.jnt_dofadr[self.ids("joint", name, model)] for name in ("motor", "joint")
        )
        return motors, joints

    def _gear_ratio(self, model: mujoco.MjModel, axis: int, findings: list[str]) -> float:
        tendon = self.ids("tendon", "gearbox")[axis]
        length = tendon_coefficients(model, tendon)
        motor, joint = float(length[self.motors[axis]]), float(length[self.joints[axis]])
        if motor and joint == -1.0 and np.isfinite(motor):
            return 1.0 / motor
        findings.append(
            f"tendon 'gearbox{axis + 1}' must have coef 1/n on motor{axis + 1} and -1 on "
            f"joint{axis + 1}"
        )
        return 1.0

    def _numeric(
        self, model: mujoco.MjModel, name: str, default: float, size: int, findings: list[str]
    ) -> np.ndarray:
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
        if index < 0:
            return np.full(size, default)
        start = model.numeric_adr[index]
        values = model.numeric_data[start : start + model.numeric_size[index]].copy()
        if len(values) == size:
            return values
        findings.append(f"numeric '{name}' has {len(values)} values, not {size}")
        return np.full(size, default)


def load_robot(name_or_path: str | Path, folders: Sequence[Path] = ()) -> Robot:
    """Load a robot by its name, from an MJCF file or from a folder.

    Args:
        name_or_path: One of `robot_names`, the path of an MJCF file whose elements have the names
            that the top of this module lists, or a folder that `Robot.write` wrote.
        folders: Further folders, beside those of the model, whose files it may use.

    Returns:
        The robot.

    Raises:
        InputError: There is no such robot, or the file lacks an element that a robot needs.
    """
    name = str(name_or_path)
    if name in robot_names():
        text = resources.files("faultgen.robots").joinpath(name, f"{name}.xml").read_text()
        return Robot(name, text)
    check_robot(name_or_path)
    path = Path(name_or_path)
    if path.is_dir():
        name, xml, assets, effects, tasks, origin = read_folder(path, folders)
        check_memory(name, xml, assets)
        return Robot(name, xml, assets, effects, tasks, origin)
    xml, assets = read_mjcf(path, folders)
    check_memory(path.stem, xml, assets)
    return Robot(path.stem, xml, assets)
