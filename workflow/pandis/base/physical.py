"""Scale of the unit frame in a device's workspace: lengths in metres, forces in newtons."""

from typing import NamedTuple

from pandis.base.frame import UNIT_SIDE


class Scale(NamedTuple):
    """The physical scale of an object that a device renders.

    Attributes
    ----------
    size : float
        Length of the object's longest side, m.
    stiffness : float
        Stiffness k, N/m.
    """

    size: float
    stiffness: float

    @classmethod
    def of(cls, options):
        """Return the scale in a stage's options (`DeviceOptions`)."""
        return cls(options.size, options.stiffness)

    @property
    def metre(self):
        """Unit-frame length of one metre."""
        return UNIT_SIDE / self.size

    @property
    def newtons(self):
        """Newtons per unit of unit-frame force computed at k = 1."""
        return self.stiffness / self.metre
