"""MJCF of drones written for the tests, in the manner of the files that people have."""

from pathlib import Path

# A Crazyflie as MuJoCo models are shared: one free body with an explicit inertia, a wrench whose
# moments have turned signs and tiny gears, fluid options, geoms to see and geoms to collide.
SMALL = """<mujoco model="small">
  <option integrator="RK4" density="1.225" viscosity="1.8e-5"/>
  <compiler inertiafromgeom="false" autolimits="true"/>
  <default>
    <default class="seen"><geom group="2" contype="0" conaffinity="0"/></default>
    <default class="hit"><geom group="3"/></default>
  </default>
  <asset><material name="grey" rgba="0.6 0.6 0.6 1"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <light pos="0 0 2"/>
    <body name="small" pos="0 0 0.1">
      <freejoint/>
      <inertial pos="0 0 0" mass="0.027" diaginertia="2.3951e-5 2.3951e-5 3.2347e-5"/>
      <geom class="seen" type="box" size="0.03 0.03 0.01" material="grey"/>
      <geom class="hit" type="box" size="0.04 0.04 0.01"/>
      <camera name="track" mode="trackcom" pos="-1 0 0.5"/>
      <site name="act"/>
    </body>
  </worldbody>
  <actuator>
    <motor ctrlrange="0 0.35" gear="0 0 1 0 0 0" site="act" name="body_thrust"/>
    <motor ctrlrange="-1 1" gear="0 0 0 -0.00001 0 0" site="act" name="x_moment"/>
    <motor ctrlrange="-1 1" gear="0 0 0 0 -0.00001 0" site="act" name="y_moment"/>
    <motor ctrlrange="-1 1" gear="0 0 0 0 0 -0.00001" site="act" name="z_moment"/>
  </actuator>
  <sensor><gyro name="gyro" site="act"/></sensor>
  <keyframe><key name="hover" qpos="0 0 0.3 1 0 0 0" ctrl="0.26487 0 0 0"/></keyframe>
</mujoco>
"""

# A larger one: mass and inertia of its geoms, so that its centre of mass lies above the body's
# origin and its principal axes are not the body's; four rotors of two heights; another time step.
BIG = """<mujoco model="big">
  <compiler autolimits="true"/>
  <option timestep="0.004" density="1.225" viscosity="1.8e-5"/>
  <default>
    <default class="big">
      <geom mass="0"/>
      <motor ctrlrange="0 13"/>
      <default class="rotor"><geom type="ellipsoid" size="0.13 0.13 0.01" group="3"/></default>
    </default>
  </default>
  <worldbody>
    <light name="spot" mode="targetbodycom" target="big" pos="0 -1 2"/>
    <body name="big" pos="0 0 0.1" childclass="big">
      <joint type="free"/>
      <geom type="box" size="0.06 0.03 0.02" pos="0.04 0 0.02" group="2"/>
      <geom name="rotor1" class="rotor" pos="-0.14 -0.18 0.05" mass="0.25"/>
      <geom name="rotor2" class="rotor" pos="-0.14 0.18 0.05" mass="0.25"/>
      <geom name="rotor3" class="rotor" pos="0.14 0.18 0.08" mass="0.25"/>
      <geom name="rotor4" class="rotor" pos="0.14 -0.18 0.08" mass="0.25"/>
      <geom type="ellipsoid" size="0.16 0.04 0.02" pos="0 0 0.02" mass="0.325"/>
      <site name="thrust1" pos="-0.14 -0.18 0.05"/>
      <site name="thrust2" pos="-0.14 0.18 0.05"/>
      <site name="thrust3" pos="0.14 0.18 0.08"/>
      <site name="thrust4" pos="0.14 -0.18 0.08"/>
    </body>
  </worldbody>
  <actuator>
    <motor class="big" name="thrust1" site="thrust1" gear="0 0 1 0 0 -0.02"/>
    <motor class="big" name="thrust2" site="thrust2" gear="0 0 1 0 0 0.02"/>
    <motor class="big" name="thrust3" site="thrust3" gear="0 0 1 0 0 -0.02"/>
    <motor class="big" name="thrust4" site="thrust4" gear="0 0 1 0 0 0.02"/>
  </actuator>
</mujoco>
"""


def write(folder: Path, text: str = SMALL, *changes: tuple[str, str], name="drone.xml") -> Path:
    """The MJCF `text` as a file, each pair of `changes` (what, by what) made in it."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    file = folder / name
    file.write_text(text)
    return file
