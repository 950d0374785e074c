"""Lengths and forces of the device's workspace, and what stands in it: a device, a hand."""

from typing import NamedTuple

from pandis.frame import UNIT_SIDE

#: Seconds between ticks.
TICK = 1e-3


class Scale(NamedTuple):
    """How the unit frame lies in the device's workspace.

    Attributes
    ----------
    size : float
        Metres of the object's longest side.
    stiffness : float
        k, N/m.
    """

    size: float
    stiffness: float

    @property
    def metre(self):
        """Unit-frame lengths per metre."""
        return UNIT_SIDE / self.size

    @property
    def newtons(self):
        """Newtons per force of the unit frame at k = 1."""
        return self.stiffness / self.metre


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
        Ticks by which a force comes late.
    force_limit : float
        N.
    hand_stiffness, hand_damping : float
        N/m and Ns/m.
    press : float
        With how many newtons the hand presses on.
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
