"""Trains a small occupancy network on one mesh of a data set, and prints the overlap (IoU).

Usage: python occupancy.py STORE NAME [STEPS]

The network sees random Fourier features of a point (Tancik et al. 2020) and learns whether the
point is inside. A tenth of the chunks is held out; the overlap is measured on their rows that are
uniform in the mesh's box. With --one-sign every label is made positive, as in data whose inside
was lost: then nothing can be learned, and the overlap is 0.
"""

import sys

import numpy as np
import torch

import pandis

FEATURES, WIDTH, BATCH = 128, 128, 8192


class Occupancy(torch.nn.Module):
    """Logit of whether points (n, 3) in the unit frame are inside."""

    def __init__(self):
        super().__init__()
        self.register_buffer("waves", 3.0 * torch.randn(3, FEATURES))
        layers, last = [], 2 * FEATURES
        for _ in range(3):
            layers += [torch.nn.Linear(last, WIDTH), torch.nn.ReLU()]
            last = WIDTH
        self.layers = torch.nn.Sequential(*layers, torch.nn.Linear(last, 1))

    def forward(self, points):
        """Return the logits (n,)."""
        angle = points @ self.waves
        return self.layers(torch.cat([angle.sin(), angle.cos()], dim=1))[:, 0]


def rows_of(store, name, chunks):
    """Return points, occupancy and stratum of some chunks of a mesh."""
    parts = [store.rows(name, int(chunk)) for chunk in chunks]
    points, distance, stratum = (
        np.concatenate([part[column] for part in parts]) for column in store.columns
    )
    return torch.from_numpy(points), torch.from_numpy(distance), torch.from_numpy(stratum)


def train(store, name, steps, *, one_sign=False):
    """Train, and return the overlap on held-out rows."""
    torch.manual_seed(0)
    if name not in store.facts:
        sys.exit(f"there is no mesh {name}; there are {', '.join(store.names[:20])}")
    count = -(-store.facts[name].rows // store.chunk)
    if count < 2:
        raise SystemExit(f"{name} has a single chunk of rows: label with a smaller --chunk")
    held_out = max(1, count // 10)
    points, distance, _ = rows_of(store, name, range(held_out, count))
    inside = ((distance.abs() if one_sign else distance) < 0).float()
    network = Occupancy()
    optimizer = torch.optim.Adam(network.parameters(), lr=2e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for step in range(steps):
        batch = torch.randint(len(points), (BATCH,))
        loss = torch.nn.functional.binary_cross_entropy_with_logits(
            network(points[batch]), inside[batch]
        )
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        if step % 100 == 0:
            print(f"step {step} of {steps}: loss {loss.item():.4f}", flush=True)
    points, distance, stratum = rows_of(store, name, range(held_out))
    volume = stratum == store.strata.index("volume")
    with torch.no_grad():
        answer, truth = network(points[volume]) > 0, distance[volume] < 0
    return ((answer & truth).sum() / (answer | truth).sum()).item()


def main():
    """Train on the mesh that the command line names."""
    words = [word for word in sys.argv[1:] if word != "--one-sign"]
    path, name, *steps = words
    store = pandis.LabelStore(path, columns=("points", "distance", "stratum"))
    overlap = train(store, name, int(*steps or [600]), one_sign="--one-sign" in sys.argv)
    print(f"overlap (IoU) on held-out rows: {overlap:.3f}")


if __name__ == "__main__":
    main()
