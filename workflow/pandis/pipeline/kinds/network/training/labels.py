"""Labels training points on the GPU that trains, so the GPU need not wait for the host's cores."""

from contextlib import contextmanager

import numpy as np
import torch

from pandis.engine.bvh import Labels
from pandis.pipeline.geometry.distance import SURFACE_DISTANCE, MeshDistance


class GpuDistance:
    """The exact distance to a mesh. Labels requested without ties are computed on a CUDA device.

    Such labels have the host's signs, and their distances differ from the host's only by rounding:
    the device searches the same tree, and also computes closest points in double precision. Unlike
    those of the stored samples, the signs are not checked by winding numbers.

    Parameters
    ----------
    engine : pandis.pipeline.geometry.distance.MeshDistance
    device : str
        Name of the Warp device.
    """

    def __init__(self, engine, device="cuda"):
        # imported here: training on a CPU does not need Warp, which takes a second to load
        from pandis.engine.cuda.meshes import MeshLabels

        self.engine = engine
        self._labels = MeshLabels(engine.tree_parts(), engine.reach, device)

    def label(self, points, ties=True, check=True):
        """Label as `MeshDistance.label` does; without ties, faces and barycentrics are None."""
        if ties:
            return self.engine.label(points, ties, check)
        distance, normal = self._labels.label(points, SURFACE_DISTANCE)
        return Labels(distance, normal, None, None, np.zeros(len(points), np.uint8))

    def distance_and_normal(self, points, progress=None, check=True):
        """Return the result of `MeshDistance.distance_and_normal`, computed on the host."""
        return self.engine.distance_and_normal(points, progress, check)


def on_device(engine, device, log):
    """Return an engine that labels on the device if possible; otherwise the given engine.

    Parameters
    ----------
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    device : {"cpu", "cuda"}
    log : pandis.base.progress.Log
    """
    if device != "cuda" or not isinstance(engine, MeshDistance):
        return engine
    try:
        return GpuDistance(engine, device)
    except (ImportError, RuntimeError) as error:
        log(f"labels come from the host's cores, so the GPU may have to wait: {error}")
        return engine


@contextmanager
def own_stream(device):
    """Run the body on a new stream if it would otherwise run on a GPU's default stream.

    Labels are computed on another stream, which would wait for all steps on the default stream.
    """
    if device != "cuda" or torch.cuda.current_stream() != torch.cuda.default_stream():
        yield
        return
    stream = torch.cuda.Stream()
    stream.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(stream):
        yield
    torch.cuda.current_stream().wait_stream(stream)
