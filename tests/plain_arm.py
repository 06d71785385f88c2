"""A plain arm with six axes as URDF, and as MJCF with all that a builder must take out."""

LINKS = (  # height of the axis [m], its direction, mass [kg], principal inertias [kg m^2]
    (0.2, "0 0 1", 6.0, "0.04 0.04 0.02"),
    (0.1, "0 1 0", 5.0, "0.09 0.09 0.015"),
    (0.35, "0 1 0", 4.0, "0.05 0.05 0.01"),
    (0.3, "0 0 1", 1.5, "0.006 0.006 0.002"),
    (0.08, "0 1 0", 1.0, "0.002 0.002 0.001"),
    (0.06, "0 0 1", 0.3, "0.0004 0.0004 0.0003"),
)
NAMES = ("pan", "lift", "elbow", "roll", "pitch", "yaw")
EFFORT = (120, 160, 80, 25, 20, 12)
SPEED = (3.0, 3.0, 3.5, 5.0, 5.0, 7.0)
TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def urdf(*changes):
    """Text of the arm as URDF, with a payload of 2 kg; `changes` are pairs of old and new text."""
    parts = ['<robot name="arm"><link name="base"/>']
    parent = "base"
    for (height, axis, mass, inertia), name, effort, speed in zip(
        LINKS, NAMES, EFFORT, SPEED, strict=True
    ):
        x, y, z = inertia.split()
        parts.append(
            f'<link name="{name}_link"><inertial><origin xyz="0.01 0 {height / 2}"/>'
            f'<mass value="{mass}"/><inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0.0001" ixz="0" '
            'iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/>'
            f'<child link="{name}_link"/><origin xyz="0 0 {height}"/><axis xyz="{axis}"/>'
            f'<limit lower="-2.6" upper="2.6" effort="{effort}" velocity="{speed}"/></joint>'
        )
        parent = f"{name}_link"
    parts.append(
        '<link name="payload"><inertial><origin xyz="0.03 0 0.05"/><mass value="2"/>'
        '<inertia ixx="0.004" iyy="0.005" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="grip" type="fixed"><parent link="yaw_link"/><child link="payload"/>'
        '<origin xyz="0 0 0.05"/></joint></robot>'
    )
    text = "".join(parts)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


MJCF = """
<mujoco model="cell">
  <compiler angle="radian" meshdir="../meshes"/>
  <asset><mesh name="hull" file="hull.obj"/></asset>
  <worldbody>
    <geom type="plane" size="2 2 0.1"/>
    <body name="box" pos="1 0 0.1"><freejoint name="loose"/><geom size="0.1"/></body>
    <body name="base">
      <freejoint name="floating"/>
      <inertial pos="0 0 0" mass="9" diaginertia="0.1 0.1 0.1"/>
      <body name="upper" pos="0 0 0.3">
        <joint name="shoulder" axis="0 0 1" range="-2 2" armature="0.5" damping="3"
          frictionloss="4"/>
        <inertial pos="0.2 0 0" mass="5" fullinertia="0.02 0.1 0.1 0.001 0.002 0.003"/>
        <geom type="mesh" mesh="hull"/>
        <body name="lower" pos="0.4 0 0">
          <joint name="elbow" axis="0 1 0" range="-2 2"/>
          <inertial pos="0.15 0 0" mass="3" diaginertia="0.01 0.04 0.04"/>
          <site name="tool0" pos="0.3 0 0"/>
          <body name="finger" pos="0.3 0.02 0">
            <joint name="grip" type="slide" axis="0 1 0" range="0 0.03"/>
            <inertial pos="0 0 0" mass="0.05" diaginertia="1e-5 1e-5 1e-5"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="grip" joint2="elbow"/></equality>
  <actuator>
    <motor name="m1" joint="shoulder" gear="50" ctrlrange="-2 2"/>
    <position name="p2" joint="elbow" kp="100" forcerange="-60 60"/>
  </actuator>
  <sensor><jointpos name="s1" joint="elbow"/></sensor>
  <keyframe><key name="home" qpos="1 0 0 1 0 0 0  0 0 0 1 0 0 0  0.3 -0.4 0"/></keyframe>
</mujoco>
"""
