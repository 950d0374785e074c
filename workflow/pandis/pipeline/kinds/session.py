"""Reads exported files, and runs ONNX models, as a user's program would."""

import json
import zipfile
from pathlib import Path
from typing import NamedTuple

import onnx
import onnxruntime

from pandis.base.errors import ArtifactError, PandisError
from pandis.pipeline.kinds.graphs import unsealed_digest
from pandis.pipeline.run.job.artifact import check_seal


class Export(NamedTuple):
    """The contents of an exported file whose seal is valid."""

    data: bytes
    metadata: dict


def read_export(path):
    """Read an exported ONNX file and check its seal.

    Raises
    ------
    ArtifactError
        The file does not parse, or its checksum is wrong.
    """
    remedy = f"rebuild it with: snakemake -j2 -R {path}"
    try:
        data = Path(path).read_bytes()
        model = onnx.load_from_string(data)
        metadata = {entry.key: entry.value for entry in model.metadata_props}
        canonical = model.SerializeToString(deterministic=True)
    except Exception as error:
        name = type(error).__name__
        raise ArtifactError(f"{path}: not readable as ONNX ({name}); {remedy}") from error
    if canonical != data or metadata.get("sha256") != unsealed_digest(model):
        raise ArtifactError(f"{path}: damaged (its checksum does not match); {remedy}")
    return Export(data, metadata)


class Session:
    """An exported field that runs in ONNX Runtime on one thread.

    Parameters
    ----------
    model : path-like or bytes
        The seal of a file is checked first.

    Raises
    ------
    ArtifactError
        The file is damaged.
    """

    def __init__(self, model):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        # a sequential session on one thread neither spins nor switches threads
        options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
        options.log_severity_level = 3
        data = model if isinstance(model, bytes) else read_export(model).data
        try:
            self._session = onnxruntime.InferenceSession(
                data, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:
            raise PandisError(f"ONNX Runtime cannot load the model: {error}") from error
        self.metadata = self._session.get_modelmeta().custom_metadata_map

    def distance_and_normal(self, points):
        """Return distance (n,) in mesh units and normal (n, 3), at points (n, 3) in mesh units."""
        return self._session.run(None, {"points": points})


def read_program_metadata(path):
    """Read the metadata of a ``.pt2`` file, and check its seal.

    Raises
    ------
    ArtifactError
        The file is damaged.
    """
    check_seal(Path(path))
    with zipfile.ZipFile(path) as archive:
        (name,) = (n for n in archive.namelist() if n.endswith("/extra/metadata.json"))
        return json.loads(archive.read(name))
