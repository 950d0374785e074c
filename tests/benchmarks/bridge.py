"""How stiff an object of MuJoCo may be: rendered at 1 kHz, or with forces held for 5 ms.

Usage: .venv/bin/python tests/benchmarks/bridge.py; prints a table.

MuJoCo moves a box of 6 cm at 200 Hz. The hand holds a simulated device and presses onto the box
from above: fixed in the world, on a floor, or on a spring. *bridge*: the haptic loop asks at every
tick of the device, and forces go back (`pandis.bridges.mujoco.bridge`). *held*: the same loop, but
a
force is computed after each step of the simulation only, and held for 5 ms, as in a simulator that
renders by itself. The stiffness rises by a factor of √2 as long as all presses stay quiet (less
than 0.1 mm of shaking above 30 Hz in the last third, and nothing that the guard has to end); the
guard's own damping is off. The last column is the ratio of the two.
"""

import sys
import tempfile
from pathlib import Path

import common  # noqa: F401 - makes pandis importable
import mujoco
import numpy as np

from pandis.bridges import mujoco as plugin
from pandis.bridges.mujoco.bridge import Bridge
from pandis.pipeline.judge.servo.devices import DEVICES, RAMP
from pandis.pipeline.judge.stress.coupled import QUIET, shaking
from pandis.runtime.device import DONE, run_simulated
from pandis.runtime.samples import sample_bytes

#: Half of the box (m), its mass (kg), the simulation's step and how long is pressed (s).
HALF, MASS, STEP, PRESSED = 0.03, 0.4, 0.005, 1.0
#: Stiffness and damping of hands (N/m, Ns/m), those of the validation's own; where they press (m).
HANDS = (0.0, 0.3), (0.0, 1.0), (0.0, 3.0), (300.0, 3.0)
PLACES = (0.0, 0.0), (0.01, 0.005)
FIRST, FACTOR, RUNGS = 40.0, 2**0.5, 17
JOINTS = {
    "fixed": "",
    "on a floor": "<freejoint/>",
    "on a spring": '<joint type="slide" axis="0 0 1" stiffness="500" damping="4"/>',
}


def model_of(path, kind):
    """Return the model of a box of 6 cm that is held in some way."""
    floor = "<geom type='plane' size='1 1 .1' pos='0 0 -0.03'/>" if kind == "on a floor" else ""
    block = f"<geom type='box' size='{HALF} {HALF} {HALF}' mass='{MASS}'/>"
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{STEP}" integrator="implicitfast" gravity="0 0 -9.81"/>
          <extension><plugin plugin="pandis.sdf"><instance name="b">
            <config key="file" value="{path}"/></instance></plugin></extension>
          <asset><mesh name="b"><plugin instance="b"/></mesh></asset>
          <worldbody>{floor}<body name="box">{JOINTS[kind]}{block}
            <geom type="sdf" mesh="b" mass="0" contype="0" conaffinity="0">
              <plugin instance="b"/></geom></body></worldbody></mujoco>""")


def is_quiet(model, device, hand, place, stiffness, held):
    """Press once; tell whether it stays quiet, and whether the device holds its own limits."""
    data = mujoco.MjData(model)
    for _ in range(200):  # it comes to rest by itself
        mujoco.mj_step(model, data)
    bridge = Bridge(model, data, stiffness=stiffness, centre=(0, 0, data.qpos[2:3].sum()))
    if model.njnt and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_SLIDE:
        bridge = Bridge(model, data, stiffness=stiffness, centre=(0, 0, data.qpos[0]))
    period = 1 / device.rate
    wait, ticks = round(RAMP / period), round((RAMP + PRESSED) / period)
    start = np.array([*place, HALF + 1e-3])
    rest, press = np.tile(start, (ticks, 1)), np.zeros((ticks, 3))
    rest[wait:, 2] = HALF - 2e-3
    press[wait:, 2] = -min(0.4 * device.force, 2.0, 0.5 * stiffness * HALF)
    limits = device.limits(period, stiffness)
    limits.most_damping = 0.0
    every = round(STEP / period)
    order = bridge.in_step(ticks, limits, period, armed=True, hold=every if held else 1)
    made = device.simulated(hand, delay=0, period=period, wall=stiffness)
    run = run_simulated(made, start, rest, press=press, order=order)
    path = run.path[wait + (len(run.path) - wait) * 2 // 3 :]
    touched = run.force[len(run.force) * 2 // 3 :].any(axis=1).mean() > 0.5
    return run.cause == DONE and touched and shaking(path, period) < QUIET


def stiffest(model, device, held):
    """Return the largest stiffness that is quiet for all hands and places, as are all below it."""
    last = 0.0
    for rung in range(RUNGS):
        stiffness = FIRST * FACTOR**rung
        every = [(hand, place) for hand in HANDS for place in PLACES]
        if not all(is_quiet(model, device, *each, stiffness, held) for each in every):
            break
        last = stiffness
    return last


def main():
    plugin.register()
    print("device,object,bridge_n_m,held_n_m,ratio")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "box.pandis"
        path.write_bytes(sample_bytes("box", HALF, HALF, HALF))
        for name, device in DEVICES.items():
            for kind in JOINTS:
                model = model_of(path, kind)
                found = [stiffest(model, device, held) for held in (False, True)]
                ratio = found[0] / found[1] if found[1] else np.inf
                print(f"{name},{kind},{found[0]:.0f},{found[1]:.0f},{ratio:.2g}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
