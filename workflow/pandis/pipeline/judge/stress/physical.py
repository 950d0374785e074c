"""What stands in the device's workspace: a device, and the hand that holds it."""

from typing import NamedTuple

#: Seconds between ticks.
TICK = 1e-3


class Device(NamedTuple):
    """A haptic device with the hand that holds it, as one mass.

    Attributes
    ----------
    mass : float
        kg, at the tip.
    damping : float
        Viscous, Ns/m.
    friction : float
        Coulomb, N.
    encoder : float
        Step of the position it reports, m.
    delay : int
        Ticks by which a force is late.
    force_limit : float
        N.
    hand_stiffness, hand_damping : float
        N/m and Ns/m.
    press : float
        Force with which the hand presses, N.
    """

    mass: float
    damping: float
    friction: float
    encoder: float
    delay: int
    force_limit: float
    hand_stiffness: float
    hand_damping: float
    press: float
