"""A bridge between MuJoCo, which moves objects, and a haptic loop, which renders them.

Each runs at its own rate, and neither waits for the other. The loop queries the objects' fields at
every tick, through a proxy. Between two steps of the simulation it advances the objects by their
velocities and their response to the hand. The reaction to the force on the hand acts on the
objects.
"""

import ctypes
from typing import Any

import numpy as np

from pandis.base.errors import PandisError
from pandis.bridges.mujoco.instances import instances
from pandis.runtime.contact import TouchedScene
from pandis.runtime.contact.surfaces import Material
from pandis.runtime.device import Limits, Order
from pandis.runtime.device import library as devices
from pandis.runtime.field import ArrayLike, Floats, NativeField, Number
from pandis.runtime.scene import Placed
from pandis.runtime.scene.poses import Poses

#: Numbers per object: impulse (3) and angular impulse (3).
_SUMS = 6
#: Trial acceleration (m/s²), a tenth of g: too small to move an object at rest.
_PROBE = 0.1 * 9.81


class Bridge:
    """Makes the geoms of a model that use the plugin `pandis.sdf` touchable.

    Parameters
    ----------
    model : mujoco.MjModel
    data : mujoco.MjData
    stiffness : float
        Stiffness of the spring that holds a probe back at a surface, N/m. Do not exceed the value
        that the validation found safe for the device.
    radius : float
        Radius of the probe, m.
    materials : dict of str to Material, optional
        Materials of geoms, by name; all other geoms are smooth and undamped.
    centre : array-like, shape (3,)
        World position of the centre of the device's workspace, m.

    Raises
    ------
    PandisError
        The model has no such geom, a material names an unknown geom, or the integrator is RK4,
        whose steps cannot be split.

    Examples
    --------
    One thread runs the device; the program itself runs the simulation in real time::

        bridge = Bridge(model, data, stiffness=400)
        thread = threading.Thread(target=lambda: run_device(library, name, bridge.order(...)))
        thread.start()
        due = time.perf_counter()
        while thread.is_alive():
            bridge.step()
            due += model.opt.timestep
            time.sleep(max(0, due - time.perf_counter()))
    """

    def __init__(
        self,
        model: Any,
        data: Any,
        *,
        stiffness: Number = 400.0,
        radius: Number = 0.0,
        materials: dict[str, Material] | None = None,
        centre: ArrayLike = (0, 0, 0),
    ) -> None:
        import mujoco

        self.model, self.data, self._mujoco = model, data, mujoco
        self.instances = instances(model)
        if not self.instances:
            raise PandisError("the model has no geom of the plugin pandis.sdf: nothing to touch")
        names = [model.geom(each.geom).name for each in self.instances]
        if unknown := sorted(set(materials or {}) - set(names)):
            raise PandisError(f"materials: no geom of pandis.sdf is called {', '.join(unknown)}")
        if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
            raise PandisError('the model\'s integrator is RK4: use integrator="implicitfast"')
        self._centre = np.array(centre, float)
        self._bodies = np.array([model.geom_bodyid[each.geom] for each in self.instances])
        self._moves = model.body_weldid[self._bodies] > 0
        mujoco.mj_step1(model, data)
        fields = {file: NativeField(file) for file in {each.file for each in self.instances}}
        placed = []
        for each in self.instances:
            rotation, translation = each.placed(data)
            field, place = fields[each.file], translation - self._centre
            placed.append(Placed(field, rotation, place, each.scale, float(stiffness)))
        chosen = [(materials or {}).get(name, Material()) for name in names]
        #: The scene that the loop queries: `pandis.runtime.contact.TouchedScene`.
        self.scene = TouchedScene(placed, float(radius), chosen)
        self.poses, count = Poses(self.scene), len(placed)
        self._library = devices()
        self._room = np.zeros(self._library.bridge_room(count))
        self._bridge = ctypes.create_string_buffer(self._library.bridge_bytes())
        self._library.bridge_open(self._bridge, self.poses.address, count, self._room.ctypes.data)
        self._before = np.zeros((count, _SUMS))
        self._now = np.zeros_like(data.xfrc_applied)
        self._hand_over()

    @property
    def address(self) -> int:
        """Address of the C bridge, for the haptic loop."""
        return ctypes.addressof(self._bridge)

    @property
    def dropped(self) -> Floats:
        """Impulse (N s) on the objects that was dropped because the simulation was late."""
        impulse = np.empty(3)
        self._library.bridge_dropped(self._bridge, impulse.ctypes.data)
        return impulse

    def order(self, ticks: int, limits: Limits, **options: Any) -> Order:
        """Restart all contacts, and return an order for one run of `pandis.runtime.device`.

        Parameters
        ----------
        ticks : int
        limits : pandis.runtime.device.Limits
            See `pandis.pipeline.judge.servo.devices.Specification.limits`.
        **options
            Further fields of `pandis.runtime.device.Order`.
        """
        self.scene.restart()
        return Order(self.scene, ticks, limits, bridge=self, **options)

    def in_step(self, ticks: int, limits: Limits, period: Number = 1e-3, **options: Any) -> Order:
        """Return an order for the simulated device, with the simulation kept in step with it.

        Runs are reproducible to the last bit, because each simulation step follows a fixed number
        of ticks.

        Raises
        ------
        PandisError
            The simulation's step is not a whole number of ticks.
        """
        every = round(self.model.opt.timestep / period)
        if every < 1 or abs(every * period - self.model.opt.timestep) > 1e-9:
            raise PandisError(
                f"the model's timestep of {self.model.opt.timestep:g} s is not a whole number "
                f"of ticks of {period:g} s: set <option timestep>"
            )
        options |= {"period": period, "between": self.step, "every": every}
        return self.order(ticks, limits, **options)

    def step(self) -> None:
        """Apply the hand's forces to the bodies, advance the simulation, and hand over the poses.

        The forces are averages over the time since the last step. They are added to
        ``data.xfrc_applied`` only during the step. The hand's forces are dropped while the
        simulation is more than four steps late; `dropped` sums them.
        """
        others = self.data.xfrc_applied.copy()
        self._now = self._reactions()
        self.data.xfrc_applied[:] = others + self._now
        # mj_step2 completes a step; mj_step1 then updates everything that depends on the state
        self._mujoco.mj_step2(self.model, self.data)
        self.data.xfrc_applied[:] = others
        self._mujoco.mj_step1(self.model, self.data)
        self._hand_over()

    def _reactions(self):
        """Return the hand's average forces and torques (bodies, 6) since the last call."""
        sums = np.empty_like(self._before)
        self._library.bridge_take(self._bridge, sums.ctypes.data)
        new = (sums - self._before) / self.model.opt.timestep
        self._before = sums
        torque = new[:, 3:] - np.cross(self._middles(), new[:, :3])
        now = np.zeros_like(self.data.xfrc_applied)
        np.add.at(now, self._bodies, np.concatenate([new[:, :3], torque], axis=1))
        return now

    def _middles(self):
        return self.data.xipos[self._bodies] - self._centre

    def _answers(self):
        """Return the bodies' responses (n, 6, 6) at their centres of mass: acceleration per force.

        They are measured by applying trial forces, because contacts and joints affect them: an
        object on a floor does not yield downward.
        """
        model, data, mujoco = self.model, self.data, self._mujoco
        matrices, turn = np.zeros((len(self._bodies), _SUMS, _SUMS)), np.empty((2, 3, model.nv))
        if not self._moves.any():
            return matrices
        warm, forces = data.qacc_warmstart.copy(), data.xfrc_applied.copy()

        def accelerations():
            data.qacc_warmstart[:] = warm
            mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_VEL, 1)
            return data.qacc.copy()

        still = accelerations()
        for i in np.nonzero(self._moves)[0]:
            body = int(self._bodies[i])
            mujoco.mj_jacBodyCom(model, data, turn[0], turn[1], body)
            jacobian = turn.reshape(_SUMS, model.nv)
            force = _PROBE * max(model.body_mass[body], 1e-9)
            arm = np.sqrt(model.body_inertia[body].max() / max(model.body_mass[body], 1e-9))
            pushes = np.repeat([force, force * max(arm, 1e-6)], 3)
            pushes = np.where(self._now[body] < 0, -pushes, pushes)  # along the hand's force
            for k in range(_SUMS):
                data.xfrc_applied[body, k] += pushes[k]
                matrices[i, :, k] = jacobian @ (accelerations() - still) / pushes[k]
                data.xfrc_applied[:] = forces
        accelerations()  # overwrites the accelerations of the trials
        data.qacc_warmstart[:] = warm
        return matrices

    def _hand_over(self):
        rotations, translations, velocities, spins = [], [], [], []
        motion, kind = np.empty(6), self._mujoco.mjtObj.mjOBJ_BODY
        for each, body in zip(self.instances, self._bodies.tolist(), strict=True):
            rotation, place = each.placed(self.data)
            self._mujoco.mj_objectVelocity(self.model, self.data, kind, body, motion, 0)
            spin, middle = motion[:3].copy(), self.data.xipos[body]
            rotations.append(rotation)
            translations.append(place - self._centre)
            velocities.append(motion[3:] + np.cross(spin, place - middle))
            spins.append(spin)
        count = len(rotations)
        parts = self._answers().reshape(count, -1), self._middles(), self._before
        rows = np.ascontiguousarray(np.concatenate(parts, axis=1))
        ctypes.memmove(self._library.bridge_next(self._bridge), rows.ctypes.data, rows.nbytes)
        self.poses.give(
            np.array(rotations), np.array(translations), np.array(velocities),
            spins=np.array(spins), period=self.model.opt.timestep,
        )  # fmt: skip
