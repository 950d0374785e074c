"""Poses that a simulation hands to a haptic loop; neither waits: ``pandis_poses``."""

import ctypes

import numpy as np

from pandis.base.errors import PandisError
from pandis.runtime.field import ArrayLike, Number
from pandis.runtime.field.binding import library as runtime
from pandis.runtime.scene import NativeScene, library


class Poses:
    """Objects of a scene that one thread moves while another queries them.

    Only one thread may call `step` and use the scene, and only one other may call `give`.

    Parameters
    ----------
    scene : pandis.runtime.scene.NativeScene
        The scene of the objects; they start at their current poses.

    Raises
    ------
    pandis.base.errors.PandisError
        An object's pose is invalid.
    """

    def __init__(self, scene: NativeScene) -> None:
        self._library, self._scene = library(), scene
        count = len(scene.objects)
        self._room = np.empty(max(self._library.scene_poses_room(count), 1))
        self._poses = ctypes.create_string_buffer(self._library.scene_poses_bytes())
        error = self._library.pandis_poses_open(
            self._poses, scene.placed_address, count, self._room.ctypes.data, len(self._room)
        )
        if error:
            raise PandisError(runtime().pandis_error_text(error).decode())
        self._count = count

    @property
    def address(self) -> int:
        """Address of the C poses, for other C code, which may step them."""
        return ctypes.addressof(self._poses)

    def give(
        self,
        rotations: ArrayLike,
        translations: ArrayLike,
        velocities: ArrayLike,
        *,
        spins: ArrayLike,
        period: Number,
    ) -> None:
        """Hand over the current poses and velocities of all objects.

        Parameters
        ----------
        rotations : ndarray, shape (n, 3, 3)
            See `pandis.runtime.scene.Placed`.
        translations, velocities : ndarray, shape (n, 3)
            Position (scene lengths) and velocity (per second) of each object's origin.
        spins : ndarray, shape (n, 3)
            Angular velocities: axis times radians per second, in scene coordinates.
        period : float
            Seconds until the next frame is due. Until then the objects move to the poses that
            their velocities predict; if the frame is late, they wait there.

        Raises
        ------
        ValueError
            An array has the wrong shape, a matrix is not a rotation, a value is not finite, or an
            object rotates by more than half a turn in a period. The previous frame is kept.
        """
        shapes = (3, 3), (3,), (3,), (3,)
        arrays = rotations, translations, velocities, spins
        parts = [np.asarray(part, np.float64) for part in arrays]
        if any(part.shape != (self._count, *s) for part, s in zip(parts, shapes, strict=True)):
            raise ValueError(
                f"the scene has {self._count} objects: pass as many rotations (3 by 3), "
                f"translations, velocities and spins, not {[part.shape for part in parts]}"
            )
        rows = np.concatenate([part.reshape(self._count, -1) for part in parts], axis=1)
        error = self._library.pandis_poses_give(self._poses, rows.ctypes.data, self._count, period)
        if error:
            raise ValueError(
                "a pose is invalid (a matrix is not a rotation, or a value is not finite or too "
                "large), an object turns more than halfway round before the next frame, or the "
                "period is outside the range 0 < period <= 1e6 s: nothing was handed over"
            )

    def step(self, dt: Number = 1e-3) -> bool:
        """Advance the objects by ``dt`` seconds; return whether a new frame had arrived."""
        return bool(self._library.pandis_poses_step(self._poses, self._scene.address, dt))
