"""Records a GPU step once and replays it: launching kernels costs more than running them."""

import threading

import torch

#: Number of steps that run before one is recorded.
_EAGER_STEPS = 3
#: Held while a step is recorded or replayed. Several trainers may share a GPU, each with its own
#: thread and stream; while one of them records, the others must not replay.
_RECORDING = threading.Lock()


class RecordedStep:
    """Takes the steps of one training run.

    Parameters
    ----------
    descend : callable
        Takes a step with rows (n, c), where n never changes, and returns the loss without
        waiting for the GPU.
    """

    def __init__(self, descend):
        self._descend, self._graph, self._eager = descend, None, 0

    def __call__(self, rows):
        """Take a step and return its loss, a tensor that the next step overwrites."""
        if self._graph is not None:
            self._rows.copy_(rows)
            with _RECORDING:
                self._graph.replay()
            return self._loss
        self._rows = rows.clone()
        # The default stream cannot be recorded. A stream that the caller has chosen is reused:
        # torch has only 32 streams, and two recordings on the same stream may share memory.
        current = torch.cuda.current_stream()
        chosen = current != torch.cuda.default_stream()
        side = current if chosen else torch.cuda.Stream()
        side.wait_stream(current)
        with torch.cuda.stream(side):
            loss = self._descend(self._rows)
        torch.cuda.current_stream().wait_stream(side)
        self._eager += 1
        if self._eager >= _EAGER_STEPS:
            graph, how = torch.cuda.CUDAGraph(), {"capture_error_mode": "thread_local"}
            with _RECORDING, torch.cuda.graph(graph, stream=side, **how):
                self._loss = self._descend(self._rows)
            self._graph = graph
        return loss
