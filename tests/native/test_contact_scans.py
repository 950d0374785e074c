"""A proxy on a scan: at rest nothing near it is nearer to the probe."""

import os
from pathlib import Path

import numpy as np
import pytest
from test_contact import approach, gain_near, metres, placed, surface_of

from pandis.base.frame import UNIT_SIDE
from pandis.pipeline.geometry.body import Body
from pandis.pipeline.kinds.compact.file import file_parts
from pandis.pipeline.kinds.compact.packing import pack_body
from pandis.pipeline.kinds.field import ExactField
from pandis.pipeline.kinds.native import native_bytes
from pandis.pipeline.mesh.build import build
from pandis.pipeline.run.ask.tasks import MeshTask
from pandis.runtime.contact import TOUCHING, NativeContact
from pandis.runtime.field import NativeField
from pandis.runtime.field.files import pack

#: Takes long: `make test-slow`.
pytestmark = pytest.mark.slow


@pytest.fixture
def real_bunny():
    """Return the exact and the compact field of the scan."""
    folder = os.environ.get("PANDIS_MESHES")
    if not folder:
        pytest.skip("PANDIS_MESHES names no folder of real meshes")
    path = Path(folder) / "stanford/bunny_35947v_69451f_binary.ply"
    arrays, _ = build(MeshTask(source=str(path), sha256=None, seed=0), path, lambda text: None)
    body = Body(arrays["vertices"], arrays["faces"])
    packed, record = pack_body(body, 16)
    compact = pack(body.frame, file_parts(packed, record), {}, version=3)
    return NativeField(native_bytes(ExactField("exact", body), {})), NativeField(compact)


def test_at_rest_on_a_scan_the_proxy_is_a_local_minimum_of_the_distance(real_bunny):
    """Pressed up to 2.5 mm deep at 10 cm, and half a millimetre aside."""
    rng, unit = np.random.default_rng(4), UNIT_SIDE / 0.1
    for field in real_bunny:
        feet, normals = surface_of(field, 200)
        gains = []
        for foot, normal in zip(metres(field, feet), normals, strict=True):
            side = np.cross(normal, rng.normal(size=3))
            end = foot - rng.uniform(5e-4, 2.5e-3) * normal + 5e-4 * side / np.linalg.norm(side)
            touches = approach(NativeContact(placed(field)), foot + 1e-3 * normal, end, rest=300)
            if touches.state[-1] & TOUCHING:
                gains.append(gain_near(field, touches.proxy[-1] * unit, end * unit, 1e-6, rng))
        assert len(gains) > 100
        # where it is no minimum at all, one in fifty, a facet of a few millionths was overlooked
        assert (np.array(gains) > 1e-8).mean() <= 0.02
        assert max(gains) < 1e-5
