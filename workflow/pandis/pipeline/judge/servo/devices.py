"""Data sheets of haptic devices, and the limits that haptic programs usually set.

Forces, stiffnesses and workspaces are the values that CHAI3D sets for each device. Encoder steps
and friction forces are the makers' nominal values, where published. Unpublished values are
assumed, and listed as such.
"""

from typing import NamedTuple

from pandis.runtime.device import NEEDS_BUTTON, Limits, Simulated

#: A force ramps up over RAMP seconds, and increases by at most IMPULSE per ms, as a share of the
#: device's largest force.
RAMP, IMPULSE = 0.5, 0.1
#: A tick may add at most TICK_ENERGY (J) to the motion of a hand that moves at HAND_SPEED (m/s).
TICK_ENERGY, HAND_SPEED = 4e-5, 0.2


class Specification(NamedTuple):
    """A haptic device.

    Attributes
    ----------
    title : str
    force : float
        Largest force, N.
    stiffness : float
        Largest stiffness that programs set for the device, N/m.
    workspace : float
        Radius of the workspace, m.
    encoder : float
        Step of the reported position, m.
    friction : float
        Coulomb friction, N.
    mass : float
        Mass at the tip, kg.
    damping : float
        Viscous damping, Ns/m.
    impulse : float
        Largest change of the force, N per ms.
    speed : float
        Largest speed, m/s.
    rate : float
        Ticks per second.
    assumed : tuple of str
        Names of the attributes that are assumed.
    continuous : float
        Largest continuous force, N; 0 if unknown.
    most_damping : float
        Largest damping that a program may add, Ns/m.
    button : bool
        Whether the device has a button that must be held while forces are sent.
    """

    title: str
    force: float
    stiffness: float
    workspace: float
    encoder: float
    friction: float
    mass: float
    damping: float
    impulse: float
    speed: float
    rate: float
    assumed: tuple
    continuous: float = 0.0
    most_damping: float = 0.0
    button: bool = False

    def simulated(self, hand, *, delay, period, wall):
        """Return the simulated device, held by a hand of given stiffness (N/m) and damping (Ns/m).

        ``wall`` is the wall's stiffness, N/m.
        """
        return Simulated(
            self.mass, self.damping, self.friction, self.encoder, self.force, self.impulse,
            self.speed, *hand, period, wall, delay,
        )  # fmt: skip

    def stiffest(self, period):
        """Return the largest gentle stiffness (N/m) at a tick period (s), up to the device's.

        A wall that reacts a tick late adds an energy of up to k (vT)^2 / 2 in that tick. A gentle
        wall adds at most `TICK_ENERGY`.
        """
        return min(self.stiffness, 2 * TICK_ENERGY / (HAND_SPEED * period) ** 2)

    def limits(self, period, stiffness):
        """Return the limits on the forces sent to this device.

        The force ramps up over `RAMP` seconds, and increases by at most `IMPULSE` per ms.

        Parameters
        ----------
        period : float
            Period of a tick, s.
        stiffness : float
            Stiffness of the wall, N/m.
        """
        change = self.impulse * period * 1e3
        step = min(change, IMPULSE * self.force * period * 1e3)
        return Limits(
            self.force, self.continuous, step, change, self.speed, RAMP / period,
            self.damping, self.encoder, stiffness, self.most_damping,
            NEEDS_BUTTON if self.button else 0,
        )  # fmt: skip


_ALWAYS = ("damping", "impulse", "speed", "most_damping")
#: Devices by name, as in the configuration.
DEVICES = {
    "touch": Specification(
        "Touch", 3.3, 400.0, 0.075, 55e-6, 0.26, 0.045, 0.1, 3.3, 1.5, 1000.0, _ALWAYS,
        0.88, 2.0, True,
    ),
    "touch-x": Specification(
        "Touch X", 7.9, 1000.0, 0.1, 23e-6, 0.06, 0.09, 0.1, 7.9, 1.5, 1000.0, (*_ALWAYS, "mass"),
        1.75, 4.0, True,
    ),
    "omega-3": Specification(
        "omega.3", 12.0, 5000.0, 0.075, 10e-6, 0.1, 0.2, 0.5, 12.0, 1.5, 4000.0,
        (*_ALWAYS, "mass", "friction"), 12.0, 40.0, True,
    ),
    "falcon": Specification(
        "Falcon", 8.0, 3000.0, 0.04, 63e-6, 0.3, 0.15, 0.3, 8.0, 1.5, 1000.0,
        (*_ALWAYS, "mass", "friction"), 0.0, 10.0, True,
    ),
}  # fmt: skip
