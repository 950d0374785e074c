"""How the unit frame lies in a device's workspace: lengths in metres, forces in newtons."""

from typing import NamedTuple

from pandis.base.frame import UNIT_SIDE


class Scale(NamedTuple):
    """The physical scale of an object under a device.

    Attributes
    ----------
    size : float
        Metres of the object's longest side.
    stiffness : float
        k, N/m.
    """

    size: float
    stiffness: float

    @classmethod
    def of(cls, options):
        """Return the scale among the options of a stage (`DeviceOptions`)."""
        return cls(options.size, options.stiffness)

    @property
    def metre(self):
        """Unit-frame lengths per metre."""
        return UNIT_SIDE / self.size

    @property
    def newtons(self):
        """Newtons per force of the unit frame at k = 1."""
        return self.stiffness / self.metre
