"""Running an exported ONNX file, as a user's program would."""

import onnxruntime

from pandis.errors import PandisError
from pandis.forces import penalty_force


class Session:
    """An exported field in ONNX Runtime, on one thread.

    Parameters
    ----------
    model : path-like or bytes
    """

    def __init__(self, model):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        # a sequential session on one thread neither spins nor hands over
        options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
        options.log_severity_level = 3
        source = model if isinstance(model, bytes) else str(model)
        try:
            self._session = onnxruntime.InferenceSession(
                source, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:
            raise PandisError(
                f"{'model' if isinstance(model, bytes) else model}: {error}"
            ) from error
        self.metadata = self._session.get_modelmeta().custom_metadata_map

    def distance_and_normal(self, points):
        """Answer distance (n,) in mesh units and normal (n, 3), at points (n, 3) in mesh units."""
        return self._session.run(None, {"points": points})

    def force(self, points, stiffness):
        """Answer the penalty force (n, 3) at points (n, 3) in mesh units."""
        return penalty_force(*self.distance_and_normal(points), stiffness)
