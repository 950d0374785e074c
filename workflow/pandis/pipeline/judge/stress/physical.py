"""Parameters of a haptic device and of the hand that holds it."""

from typing import NamedTuple

#: Seconds between ticks.
TICK = 1e-3


class Device(NamedTuple):
    """A haptic device with the hand that holds it, as one mass.

    Attributes
    ----------
    mass : float
        Mass at the tip, kg.
    damping : float
        Viscous damping, Ns/m.
    friction : float
        Coulomb friction, N.
    encoder : float
        Step of the reported position, m.
    delay : int
        Delay of a force, ticks.
    force_limit : float
        Largest force, N.
    hand_stiffness, hand_damping : float
        Stiffness, N/m, and damping, Ns/m, of the hand.
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
