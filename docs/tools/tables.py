"""Tables of the documentation, generated from the measured figures in docs/figures."""

import csv
from pathlib import Path

from pandis.pipeline.judge.errors.paths import spread

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "figures"


def _row(cells):
    return "| " + " | ".join(cells) + " |"


def _noted(lines, notes):
    """Return lines as text, followed by notes on their measurement."""
    return "\n".join([*lines, "", f"({'; '.join(notes)}.)"])


#: A reader's need, and the field of the default run that meets it.
_WISHES = {
    "exact forces": "exact",
    "a small field": "compact-auto",
    "a smooth force": "spline-auto",
    "a network": "pandis-exact",
    "the paper's network": "pandis",
}


def which_table():
    """Return the README's table of recommended fields, with figures of the default run's bunny."""
    notes, rows = _bunny()
    by_name = {row["field"]: row for row in rows}
    table = [
        "| need | field | KB | force error, mean | surface without force | failed questions "
        "| one query, median |",
        "|---|---|--:|--:|--:|--:|--:|",
    ]
    for wish, field in _WISHES.items():
        row = by_name[field]
        error = f"{float(row['contact_millinewtons']):.3g} mN "
        error += f"({float(row['contact_percent']):.2g} %)"
        cells = [wish, f"`{field}`", f"{int(row['bytes']) / 1000:,.0f}", error]
        cells += [f"{float(row['missing_percent']):.2g} %", str(row["stress"])]
        table.append(_row([*cells, f"{float(row['native_p50_us']):.2g} µs"]))
    return _noted(table, notes)


def bunny_table():
    """Return the default run's figures for ``bunny``."""
    notes, rows = _bunny()
    table = [
        "| field | bytes | contact error | of the mean force | surface missing | questions failed "
        "| on the path | shallow | deep | one query, median |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        errors = (row[f"{name}_mean"] for name in ("trajectory", "shallow", "deep"))
        cells = " | ".join(f"{1e3 * float(error):.2f}e-3" for error in errors)
        time = f"{float(row['native_p50_us']):.2g} µs"
        contact = f"{float(row['contact_millinewtons']):,.3g} mN"
        contact += f" | {float(row['contact_percent']):.2g} %"
        contact += f" | {float(row['missing_percent']):.2g} % | {row['stress']}"
        start = f"| `{row['field']}` | {int(row['bytes']):,} | {contact}"
        table.append(f"{start} | {cells} | {time} |")
    return _noted(table, notes)


#: Query times in C: along the path, anywhere in the box, along the path with empty caches.
_TIMES = (
    "native_p50_us", "native_p999_us", "anywhere_p50_us", "anywhere_max_us",
    "native_cold_p50_us", "native_cold_max_us",
)  # fmt: skip


def time_table():
    """Return the times in C of the default run's fields for ``bunny``, warm and cold."""
    notes, rows = _bunny()
    table = [
        "| field | along the path, median (µs) | p99.9 | anywhere, median | worst place "
        "| empty caches, median | worst |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        times = (f"{float(row[key]):.3g}" for key in _TIMES)
        table.append(f"| `{row['field']}` | {' | '.join(times)} |")
    return _noted(table, notes)


def _bunny():
    """Return the notes of the default run, and the rows of the fields of its bunny."""
    notes, rows = read_figures("default")
    return notes, [row for row in rows if row["mesh"] == "bunny" and row["bytes"]]


def read_figures(name):
    """Return the notes and the rows of a file of measured figures."""
    lines = (FOLDER / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    notes = [line.removeprefix("# ") for line in lines if line.startswith("#")]
    return notes, list(csv.DictReader(line for line in lines if not line.startswith("#")))


#: Errors of correct code on the sphere (% of the mean force), and those printed in the paper.
_SPHERE = {
    "exact": (0, "0"),
    "nearest-100": (15, "0.097"),
    "trilinear-100": (0.25, "0.082"),
    "salisbury": (1.5, "0.083"),
    "kim-100": (0.24, "0.367"),
    "kim-ray-100": (0.23, ""),
    "kim-cell-100": (33, ""),
    "kim-algebraic-100": (95, ""),
    "support-planes-only": (7.3, ""),
    "support-planes-distance": (5.4, ""),
    "support-planes": (0.27, "0.296"),
    "pandis": ("", "0.162"),
}


def sphere_table():
    """Return the table of docs/sphere.md: the paper's Table 5, reproduced."""
    notes, rows = read_figures("sphere")
    table = [
        "| field | KB | mean error (k·r) | % of the mean force | expected | in the paper |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        if row["bytes"]:
            expected, printed = _SPHERE.get(row["field"], ("", ""))
            cells = [f"`{row['field']}`", f"{int(row['bytes']) / 1e3:,.0f}"]
            cells.append(f"{float(row['trajectory_mean']) / 0.9:.2g}")
            cells += [f"{float(row['trajectory_percent']):.2g}", f"{expected}", printed]
            table.append(_row(cells))
    return _noted(table, notes)


def repair_table():
    """Return the table of docs/repair.md: the outcome for every mesh of a collection."""
    notes, rows = read_figures("repair")
    table = [
        "| file | outcome | rungs kept | source to result, p99 / max (%) | result to source (%) "
        "| caps, hidden (% of area) | untouched (%) | s | MB |",
        "|---|---|---|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        outcome = row["outcome"] + (f": `{row['option']}`" if row["option"] else "")
        figures = [
            f"{_short(row['to_result_p99_percent'])} / {_short(row['to_result_max_percent'])}",
            f"{_short(row['to_source_p99_percent'])} / {_short(row['to_source_max_percent'])}",
            f"{_short(row['caps_percent'])}, {_short(row['hidden_percent'])}",
            _short(row["untouched_percent"]),
        ]
        if row["outcome"].startswith("refused"):
            figures = ["–"] * 4
        cells = [f"{row['folder']}/{row['file']}", outcome, row["rungs"] or "–", *figures]
        cells += [f"{float(row['seconds']):.0f}", f"{float(row['memory_mb']):.0f}"]
        table.append(_row(cells))
    valid = sum(row["outcome"] == "valid" for row in rows)
    with_option = sum(row["outcome"] == "valid with option" for row in rows)
    summary = (
        f"Of {len(rows)} files, {valid} become valid with the default options, {with_option} more "
        f"with the option that the refusal names. {len(rows) - valid - with_option} are refused."
    )
    return _noted([summary, "", *table], notes)


def field_table():
    """Return the table of the sizes and errors of our grids and splines."""
    notes, rows = read_figures("fields")
    meshes = list(dict.fromkeys(row["mesh"] for row in rows))
    cells = {(row["mesh"], row["field"]): row for row in rows}
    table = [
        "| field | in memory (KB) | " + " | ".join(f"{mesh}, on disk (KB)" for mesh in meshes)
        + " | " + " | ".join(f"{mesh}, shallow / deep" for mesh in meshes) + " | built in (s) |",
        "|---" + "|--:" * (2 + 2 * len(meshes)) + "|",
    ]  # fmt: skip
    for field in dict.fromkeys(row["field"] for row in rows):
        rows_of_field = [cells[mesh, field] for mesh in meshes]
        row = [field, f"{int(rows_of_field[0]['bytes']) / 1e3:,.0f}"]
        row += [f"{int(f['disk_bytes']) / 1e3:,.0f}" for f in rows_of_field]
        row += [
            f"{1e3 * float(f['shallow']):.2f} / {1e3 * float(f['deep']):.2f}" for f in rows_of_field
        ]
        row.append(f"{min(float(f['build_s']) for f in rows_of_field):.1f}"
                   f"–{max(float(f['build_s']) for f in rows_of_field):.1f}")  # fmt: skip
        table.append(_row(row))
    return _noted(table, notes)


def compact_table():
    """Return the table of compact meshes against the exact one."""
    notes, rows = read_figures("compact")
    table = [
        "| mesh, faces | field | bytes a face | shallow / deep | missing | bound, largest error "
        "| wrong sides, cut | on the path, 99.9 % (µs) | in the box (µs) "
        "| ratio to `exact`, path and box |",
        "|---" * 2 + "|--:" * 8 + "|",
    ]
    for row in rows:
        times = {key: float(value) for key, value in row.items() if key.endswith("_us")}
        cells = [f"{row['mesh']}, {int(row['faces']):,}", f"`compact-{row['bits']}`"]
        cells += [f"{float(row['bytes']):.2f}"]
        cells += [f"{1e3 * float(row['shallow']):.4f} / {1e3 * float(row['deep']):.4f}"]
        cells += [f"{100 * float(row['missing']):.3g} %"]
        cells += [f"{1e3 * float(row['bound']):.3f}, {1e3 * float(row['largest']):.3f}"]
        cells += [f"{row['wrong']}, {row['cut']}"]
        cells += [f"{times['path_us']:.2f}, {times['path_p999_us']:.1f}"]
        cells += [f"{times['box_us']:.1f}"]
        ratios = [times[f"{where}_us"] / times[f"exact_{where}_us"] for where in ("path", "box")]
        cells += [" and ".join(f"{ratio:.2f}" for ratio in ratios)]
        table.append(_row(cells))
    return _noted(table, notes)


def small_table():
    """Return the table of compact meshes and splines at small sizes."""
    notes, rows = read_figures("small")
    table = [
        "| mesh | at most (KB) | `compact-auto`: faces, bits | shallow / deep | contact, missing "
        "| `spline-auto`: shallow / deep | contact, missing "
        "| multiple of the spline's error: shallow and contact |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    kinds = ("compact-auto", "spline-auto")
    by_case = {(row["mesh"], row["budget"], row["kind"]): row for row in rows}
    for mesh, budget in dict.fromkeys((row["mesh"], row["budget"]) for row in rows):
        packed, spline = (by_case[mesh, budget, kind] for kind in kinds)
        cells = [mesh, f"{int(budget) / 1000:,.0f}"]
        cells += [f"{int(packed['faces']):,}, {packed['bits']}" if packed["bits"] else "–"]
        for row in (packed, spline):
            cells += [" / ".join(_thousandths(row[name]) for name in ("shallow", "deep"))]
            cells += [f"{_thousandths(row['contact'])}, {_percent(row['missing'])}"]
        known = packed["bits"] and spline["contact"]
        ratios = (
            [float(packed[name]) / float(spline[name]) for name in ("shallow", "contact")]
            if known
            else []
        )
        table.append(_row([*cells, " and ".join(f"{ratio:.3g}" for ratio in ratios) or "–"]))
    return _noted(table, notes)


def hashgrid_table():
    """Return the table of hash grids beside everything else of their size."""
    notes, rows = read_figures("hashgrid")
    kinds = tuple(dict.fromkeys(row["kind"] for row in rows))
    table = [
        _row(["mesh", "at most (KB)", *(kind if " " in kind else f"`{kind}`" for kind in kinds)]),
        "|---|" + "--:|" * (1 + len(kinds)),
    ]
    by_case = {(row["mesh"], row["budget"], row["kind"]): row for row in rows}
    for mesh, budget in dict.fromkeys((row["mesh"], row["budget"]) for row in rows):
        cells = [mesh, f"{int(budget) / 1000:,.0f}"]
        for row in (by_case[mesh, budget, kind] for kind in kinds):
            errors = " / ".join(f"{1e3 * float(row[name]):.2f}" for name in ("contact", "deep"))
            cells += [f"{errors}, {_percent(row['missing'])}, {float(row['one_us']):.2f} µs"]
        table.append(_row(cells))
    return _noted(table, notes)


def _thousandths(value):
    return f"{1e3 * float(value):.3g}" if value else "–"


def _percent(value):
    return f"{100 * float(value):.2g} %" if value else "–"


def refit_table():
    """Return the table of deforming meshes."""
    notes, rows = read_figures("refit")
    table = [
        "| mesh, faces | shapes | refit, worst (ms) | distances compared, unequal "
        "| query, 99.9 % (µs) | with a new tree (µs) | ratio |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        times = {key: float(value) for key, value in row.items() if key.endswith(("_us", "_ms"))}
        cells = [f"{row['mesh'].partition(',')[0]}, {int(row['faces']):,}", row["frames"]]
        cells += [f"{times['refit_ms']:.2f}, {times['refit_worst_ms']:.1f}"]
        cells += [f"{int(row['compared']):,}, {row['unequal']}"]
        cells += [f"{times['query_us']:.2f}, {times['query_p999_us']:.1f}"]
        cells += [f"{times['fresh_us']:.2f}, {times['fresh_p999_us']:.1f}"]
        table.append(_row([*cells, f"{times['query_us'] / times['fresh_us']:.2f}"]))
    return _noted(table, notes)


def worst_table():
    """Return the table of the slowest queries of meshes."""
    notes, rows = read_figures("worst")
    table = [
        "| body, faces | field | slowest query (µs) | in the box, median (µs) "
        "| cut in the contact set | cut in the box | too large by, contact set and box |",
        "|---|---|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        cells = [f"{row['mesh']}, {int(row['faces']):,}", f"`{row['field']}`"]
        cells += [f"{float(row['slowest_us']):.0f}", f"{float(row['box_us']):.1f}"]
        for where in ("contact", "box"):
            cells.append(_percent(int(row[f"cut_{where}"]) / int(row[where])))
        cells.append(" and ".join(f"{float(row[f'off_{w}']):.1e}" for w in ("contact", "box")))
        table.append(_row(cells))
    return _noted(table, notes)


#: Ways to ask for distances, the column of `peers_table`, and the figure of a way.
_PEERS = {
    "pandis exact": "`exact`",
    "pandis compact-16": "`compact-16`",
    "Embree 3, unsigned": "Embree",
    "fcpw, unsigned": "fcpw",
    "fcpw, and whether inside": "fcpw and side",
    "Open3D, signed": "Open3D",
}


def peers_table():
    """Return the table of distance queries of pandis and of other libraries."""
    notes, rows = read_figures("peers")
    table = [_row(["points", "meshes", *_PEERS.values()]), "|---|---|" + "--:|" * len(_PEERS)]
    for points in ("path", "near", "box", "centre"):
        for name, meshes in (("scans", ("bunny", "armadillo", "dragon")), ("ball", ("ball",))):
            cells = [points, name]
            for way in _PEERS:
                those = [row for row in rows if row["way"] == way and row["points"] == points]
                times = [float(row["median_us"] or row["mean_us"])
                         for row in those if row["mesh"] in meshes]  # fmt: skip
                ends = (f"{t:,.2f}" if t < 100 else f"{t:,.0f}" for t in (min(times), max(times)))
                cells.append(" to ".join(dict.fromkeys(ends)))
            table.append(_row(cells))
    return _noted(table, notes)


def large_table():
    """Return the table of a mesh of ten million faces."""
    notes, rows = read_figures("large")
    table = [
        "| stage | task | seconds | peak memory (GiB) | output (MB) | bytes a face |",
        "|---|---|--:|--:|--:|--:|",
    ]
    for row in rows:
        cells = [f"`{row['stage']}`", row["what"], row["seconds"]]
        cells += [f"{int(row['peak_mib']) / 1024:.1f}", f"{float(row['mb']):.0f}"]
        table.append(_row([*cells, f"{float(row['bytes_per_face']):.1f}"]))
    return _noted(table, notes)


def press_table():
    """Return the table of presses through thin places."""
    notes, rows = read_figures("presses")
    table = [
        "| shape | field | surface without force | largest error at the surface (mm) | presses "
        "| went through, proxy | went through, penalty | deepest proxy (mm) "
        "| strongest force, proxy and penalty (N) |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for shape, field in dict.fromkeys((row["shape"], row["field"]) for row in rows):
        of_it = [row for row in rows if (row["shape"], row["field"]) == (shape, field)]
        first, pressed = of_it[0], [row for row in of_it if int(row["presses"] or 0)]
        cells = [shape, f"`{field}`", _percent(float(first["missing"]))]
        cells += [f"{float(first['error_mm']):.2g}"]
        if not pressed:
            table.append(_row([*cells, "not pressed", *[""] * 4]))
            continue
        total = {
            k: sum(int(r[k]) for r in pressed) for k in ("presses", "passes", "penalty_passes")
        }
        cells += [f"{total[name]:,}" for name in ("presses", "passes", "penalty_passes")]
        cells += [f"{max(float(row['deepest_mm']) for row in pressed):.3f}"]
        most = [max(float(row[f"{k}strongest_n"]) for row in pressed) for k in ("", "penalty_")]
        table.append(_row([*cells, " and ".join(f"{value:.1f}" for value in most)]))
    return _noted(table, notes)


def simulator_table():
    """Return the table of fields in MuJoCo."""
    notes, rows = read_figures("simulator")
    table = [
        "| scene | field | shallow error | contact error (mN) | step, median (µs) "
        "| ratio to depth 6 | starts | tunnelled | overlap, median and 99 % (mm) "
        "| energy rises by, median and 99 % (weight · mm) |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    native = {row["scene"]: float(row["step_us"]) for row in rows if row["field"] == "native-6"}
    for row in rows:
        step = float(row["step_us"])
        off = [float(row[name]) for name in ("shallow", "contact_mn")]
        shallow, contact = (f"{value:.2g}" if value > 1e-9 else "0" for value in off)
        cells = [row["scene"], f"`{row['field']}`", f"{shallow}e-3", contact, f"{step:,.0f}"]
        cells += [f"{step / native[row['scene']]:.2g}", row["starts"], row["tunnelled"]]
        cells += [f"{float(row['overlap']):.2f}, {float(row['overlap_p99']):.2f}"]
        rises = [1e3 * float(row[name]) for name in ("rise", "rise_p99")]
        table.append(_row([*cells, ", ".join(f"{value:.2g}" for value in rises)]))
    return _noted(table, notes)


def cluster_table():
    """Return the table of resources that rules request from a cluster, and use."""
    notes, rows = read_figures("cluster")
    table = ["| rule | jobs | cores | memory requested, most used (MB) | time requested (min), "
             "longest (s) |", "|---|--:|--:|--:|--:|"]  # fmt: skip
    for row in rows:
        memory = f"{int(row['mem_mb']):,}, {float(row['max_mb']):,.0f}"
        times = f"{row['runtime_min']}, {float(row['max_s']):.0f}"
        table.append(_row([f"`{row['rule']}`", row["jobs"], row["threads"], memory, times]))
    return _noted(table, notes)


def bridge_table():
    """Return the table of stiffnesses for objects that MuJoCo moves."""
    notes, rows = read_figures("bridge")
    table = ["| device | box | bridge (N/m) | held for 5 ms (N/m) | ratio |"]
    table.append("|---|---|--:|--:|--:|")
    for row in rows:
        stiffness, ratio = float(row["held_n_m"]), float(row["ratio"])
        cells = [row["device"], row["object"], f"{float(row['bridge_n_m']):,.0f}"]
        cells += [
            f"{stiffness:,.0f}" if stiffness else "below 40",
            f"{ratio:.3g}" if stiffness else "–",
        ]
        table.append(_row(cells))
    return _noted(table, notes)


def kernels_table():
    """Return the table of fields in Warp."""
    notes, rows = read_figures("kernels")
    table = [
        "| field | points | device | million points per second | `pandis.h` on the same machine "
        "| largest difference, distance | gradient |",
        "|---|---|---|--:|--:|--:|--:|",
    ]
    for row in rows:
        cells = [f"`{row['field']}`", row["points"], row["device"]]
        cells += [f"{float(row[name]):.2g}" if float(row[name]) < 100 else f"{float(row[name]):.0f}"
                  for name in ("mega_points_per_s", "pandis_h_mega_points_per_s")]  # fmt: skip
        table.append(_row([*cells, *(f"{float(row[k]):.0e}" for k in ("distance", "gradient"))]))
    return _noted(table, notes)


def cooked_table():
    """Return the table of distances baked by Newton and written by `cook`."""
    notes, rows = read_figures("cooked")
    table = [
        "| mesh | resolution | read on | nodes | MB | made in (s) | shallow error, mean and 99 % "
        "| ratio to Newton | deep error, mean and 99 % | ratio to Newton |",
        "|---|--:|---|---|--:|--:|--:|--:|--:|--:|",
    ]
    by_mesh = {}
    for row in rows:
        which = row["mesh"], row["resolution"], row["device"]
        by_mesh.setdefault(which, row)  # Newton's comes first
        cells = [row["mesh"], row["resolution"], row["device"], row["nodes"]]
        cells += [f"{float(row['mb']):.2g}", f"{float(row['seconds']):.2g}"]
        for kind in ("shallow", "deep"):
            off, most = float(row[kind]), float(row[f"{kind}_p99"])
            cells += [f"{off:.2f}e-3, {most:.1f}e-3", f"{off / float(by_mesh[which][kind]):.2f}"]
        table.append(_row(cells))
    return _noted(table, notes)


def solid_table():
    """Return the table of solids by several methods."""
    notes, rows = read_figures("solid")
    titles = {"pandis": "**pandis, 256 cells**", "pcu": "point-cloud-utils", "wrap": "alpha wrap",
              "udf": "offset by half a cell, 128", "mesh2sdf": "mesh2sdf, 128"}  # fmt: skip
    table = [
        "| method | answered | valid | crossing | hidden | components lost | from the visible "
        "source, p99: median (cells) | within 0.5 | within 1 | IoU, median and least | faces "
        "(median) | CPU s, median and 95 % |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        share = [f"{100 * float(row[key]):.0f} %" for key in ("p99_half", "p99_one")]
        table.append(_row([
            titles[row["method"]], f"{row['answered']} of {row['meshes']}", row["valid"],
            row["crossings"], row["hidden"],
            f"{row['lost']} of {row['components']}",
            f"{float(row['p99_median']):.2f}", *share,
            f"{float(row['iou_median']):.4f}, {float(row['iou_least']):.3f}",
            f"{int(row['faces_median']):,}",
            f"{float(row['cpu_median']):.1f}, {float(row['cpu_p95']):.1f}",
        ]))  # fmt: skip
    return _noted(table, notes)


def signs_table():
    """Return the table of wrong signs of libraries, in per mille of the points of each mesh."""
    notes, rows = read_figures("signs")
    names = list(dict.fromkeys(row["mesh"] for row in rows))
    table = [
        "| library | version | " + " | ".join(names) + " |",
        "|---|---|" + "--:|" * len(names),
    ]
    for library in dict.fromkeys(row["library"] for row in rows):
        same = [row for row in rows if row["library"] == library]
        cells = [
            "–" if row["error"] else _per_mille(int(row["wrong"]), int(row["points"]))
            for row in same
        ]
        table.append(_row([library, same[0]["version"] or "this one", *cells]))
    return _noted(table, notes)


def _per_mille(wrong, points):
    share = 1000 * wrong / points
    return f"{share:.0f}" if share >= 10 or not wrong else f"{share:.2g}"


def contact_table():
    """Return the table of a contact's cost, force and depth."""
    notes, rows = read_figures("contact")
    table = [
        "| field | motion | ticks | touching | queries, median and 99.9 % | µs, median and 99.9 % "
        "| steepest (N/ms), beyond its bound | proxy too deep | deepest (mm) |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        cells = [f"`{row['field']}`", row["motion"], f"{int(row['ticks']):,}"]
        cells += [_percent(float(row["touching"]))]
        cells += [f"{float(row['queries']):.0f}, {float(row['queries_p99.9']):.0f}"]
        cells += [f"{float(row['us']):.1f}, {float(row['us_p99.9']):.0f}"]
        cells += [f"{float(row['steepest_n_per_ms']):.2f}, {row['over_bound']}", row["passes"]]
        table.append(_row([*cells, f"{float(row['deepest_mm']):.3f}"]))
    return _noted(table, notes)


def distance_table():
    """Return the table of exact distances: speed and memory."""
    notes, rows = read_figures("distances")
    table = ["| what | case | measured | ratio or exponent |", "|---|---|--:|--:|"]
    for row in rows:
        value = float(row["value"])
        text = f"{value:,.0f}" if value >= 100 else f"{value:.3g}"
        ratio = f"{float(row['ratio']):.2f}" if row["ratio"] else ""
        table.append(f"| {row['what']} | {row['case']} | {text} {row['unit']} | {ratio} |")
    return _noted(table, notes)


def training_table(name="training"):
    """Return a table of docs/training.md, with one row per trained network."""
    notes, rows = read_figures(name)
    table = [
        "| mesh | recipe | options | steps | s | points/s | KB | shallow | deep | on the path |",
        "|---|---|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        options = [o for o in row["options"].split() if not o.startswith(("steps=", "device="))]
        cells = [row["mesh"], f"`{row['recipe']}`", f"`{' '.join(options)}`" if options else ""]
        cells += [f"{int(row['steps']):,}", f"{float(row['seconds']):.0f}"]
        cells += [f"{float(row['points_per_s']):,.0f}", f"{int(row['bytes']) / 1e3:,.0f}"]
        cells += [f"{1e3 * float(row[k]):.3g}" for k in ("shallow", "deep", "trajectory")]
        table.append(_row(cells))
    return _noted(table, notes)


#: Error columns of the paper's comparison.
_ERRORS = ("shallow", "deep", "contact", "path")
#: The paper's Table 4: error of PANDIS / error of Tri-i 64³, on the mesh's own box.
_PAPER = {"bunny": 0.006 / 0.026, "armadillo": 0.022 / 0.046, "dragon": 0.068 / 0.041}
_PAPER["dragon-full"] = _PAPER["dragon"]  # a scan as large as the paper's
_BOXES = {"trilinear-box-64": "its own", "trilinear-64": "the cube"}


def _over_seeds(rows, keys):
    """Return lists of rows that differ only in their seed."""
    groups = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    return list(groups.values())


def full_table():
    """Return the table of the paper's comparison, with networks trained to the end."""
    notes, rows = read_figures("full")
    table = [
        "| mesh | field | training | seeds | KB | shallow | deep | contact | missing (%) "
        "| on the path | ratio to `trilinear-box-64` | ratio to `trilinear-64` |",
        "|---|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    base = {(row["mesh"], row["field"]): float(row["path"]) for row in rows}
    for seeds in _over_seeds(rows, ("mesh", "field", "weighting", "points", "steps")):
        first = seeds[0]
        cells = [first["mesh"], f"`{first['field']}`", _trained(first)]
        cells.append(f"{len(seeds)}" if first["seed"] else "")
        cells.append(f"{int(first['bytes']) / 1e3:,.0f}")
        values = {key: [float(row[key]) for row in seeds] for key in (*_ERRORS, "missing")}
        cells += [spread([1e3 * v for v in values[k]], ".3g") for k in _ERRORS[:-1]]
        cells.append(spread([100 * v for v in values["missing"]], ".2g"))
        cells.append(spread([1e3 * v for v in values["path"]], ".3g"))
        for box in _BOXES:
            cells.append(spread([v / base[first["mesh"], box] for v in values["path"]], ".2f"))
        table.append(_row(cells))
    return _noted(table, notes)


def _trained(row):
    """Describe the training of a row's network."""
    if not row["steps"]:
        return ""
    words = [f"{int(row['steps']):,} steps"]
    words += [f"`weighting: {row['weighting']}`"] if row["weighting"] else []
    words += ["`points: vertices`"] if row["points"] == "vertices" else []
    return ", ".join(words)


def order_table():
    """Return the table of ratios of PANDIS's error to Tri-i 64³'s, by scan, box and measure."""
    notes, rows = read_figures("full")
    table = [
        "| mesh | box of the grid | training | seeds | the paper's path | on the path | shallow "
        "| deep | contact |",
        "|---|---|---|--:|--:|--:|--:|--:|--:|",
    ]
    grids = {(r["mesh"], r["field"]): r for r in rows if r["field"] in _BOXES}
    networks = [row for row in rows if row["field"] == "pandis"]
    for seeds in _over_seeds(networks, ("mesh", "weighting", "points", "steps")):
        mesh = seeds[0]["mesh"]
        for box, label in _BOXES.items():
            paper = f"{_PAPER[mesh]:.2f}" if label == "its own" else ""
            cells = [mesh, label, _trained(seeds[0]), f"{len(seeds)}", paper]
            for key in ("path", "shallow", "deep", "contact"):
                base = float(grids[mesh, box][key])
                cells.append(spread([float(row[key]) / base for row in seeds], ".2f"))
            table.append(_row(cells))
    return _noted(table, notes)


def ablation_table():
    """Return the table of each change's effect, from the paper's recipe to ours."""
    notes, rows = read_figures("ablation")
    table = [
        "| change | applied | seeds | shallow | deep | contact | missing (%) | on the path |",
        "|---|---|--:|--:|--:|--:|--:|--:|",
    ]
    labels = {"": "", "alone": "alone", "added": "added to those above"}
    groups = {
        (seeds[0]["how"], seeds[0]["what"]): seeds for seeds in _over_seeds(rows, ("how", "what"))
    }
    for (how, what), seeds in groups.items():
        cells = [f"{what}" if how else "none: `pandis`", labels[how], f"{len(seeds)}"]
        values = {key: [float(row[key]) for row in seeds] for key in (*_ERRORS, "missing")}
        cells += [spread([1e3 * v for v in values[k]], ".3g") for k in _ERRORS[:-1]]
        cells.append(spread([100 * v for v in values["missing"]], ".2g"))
        cells.append(spread([1e3 * v for v in values["path"]], ".3g"))
        table.append(_row(cells))
    return _noted(table, notes)


def budget_table():
    """Return the table of error by budget: a row per mesh, a column per number of steps."""
    notes, rows = read_figures("budgets")
    first = [row for row in rows if "seed=" not in row["options"]]
    budgets = list(dict.fromkeys(int(row["steps"]) for row in first))
    table = [
        "| mesh | " + " | ".join(f"{steps:,}" for steps in budgets) + " | four seeds |",
        "|---" + "|--:" * (len(budgets) + 1) + "|",
    ]
    for mesh in dict.fromkeys(row["mesh"] for row in rows):
        by_steps = {int(row["steps"]): row for row in first if row["mesh"] == mesh}
        cells = [_pair(by_steps[steps]) for steps in budgets]
        seeded = [row for row in rows if row["mesh"] == mesh and "seed=" in row["options"]]
        seeded.append(by_steps[int(seeded[0]["steps"])])
        errors = [float(row["shallow"]) for row in seeded]
        spread = (max(errors) - min(errors)) / min(errors)
        cells.append(f"{len(seeded)} × {int(seeded[0]['steps']):,}: {100 * spread:.1f} %")
        table.append(f"| {mesh} | " + " | ".join(cells) + " |")
    return _noted(table, notes)


def _pair(row):
    return " / ".join(f"{1e3 * float(row[key]):.3g}" for key in ("shallow", "deep"))


def sweep_table():
    """Return the table of one option changed at a time, on a GPU."""
    notes, rows = read_figures("training_gpu")
    cells = {}
    for row in rows:
        changes = dict(pair.split("=") for pair in row["options"].split())
        changes.pop("device")
        steps = int(changes.pop("steps"))
        if row["recipe"] == "pandis-exact" and changes:
            more = [f"{steps:,} steps"] if steps != 3800 else []
            change = ", ".join([*(f"`{key}` {value}" for key, value in changes.items()), *more])
            cells.setdefault(change, {})[row["mesh"]] = _pair(row)
    meshes = list(dict.fromkeys(mesh for pairs in cells.values() for mesh in pairs))
    table = ["| change | " + " | ".join(meshes) + " |", "|---" + "|--:" * len(meshes) + "|"]
    table += [_row([change, *(pairs[mesh] for mesh in meshes)]) for change, pairs in cells.items()]
    return _noted(table, notes)


def base_table():
    """Return the table of the base's effect, near the surface and away from it."""
    notes, rows = read_figures("base")
    table = [
        "| mesh | steps | base, cells | `far` | KB | shallow | deep "
        "| largest ghost | ghosts (%) | deeper (%) |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        changes = dict(pair.split("=") for pair in row["options"].split())
        cells = [row["mesh"], f"{int(row['steps']):,}", changes["base"].replace("None", "none")]
        cells += [changes.get("far", "0.3"), f"{int(row['bytes']) / 1e3:,.0f}"]
        cells += [f"{1e3 * float(row[key]):.3g}" for key in ("shallow", "deep", "ghost")]
        cells += [f"{100 * float(row[key]):.2g}" for key in ("ghosts", "core")]
        table.append(_row(cells))
    return _noted(table, notes)


def throughput_table():
    """Return the table of points per second, on two cores and on a GPU."""
    parts = []
    for device in ("cpu", "cuda"):
        notes, rows = read_figures(f"throughput_{device}")
        parts += [
            "| what | ms per step | points/s | × a plain loop's | GFLOP/s |",
            "|---|--:|--:|--:|--:|",
        ]
        for row in rows:
            cells = [row["what"], f"{float(row['ms']):.3g}"]
            cells.append(f"{float(row['points_per_s']):,.0f}" if row["points_per_s"] else "")
            cells += [f"{float(row['ratio']):.2f}" if row["ratio"] else ""]
            cells += [f"{float(row['gflops']):,.0f}" if row["gflops"] else ""]
            parts.append(_row(cells))
        parts += ["", f"({'; '.join(notes)}.)", ""]
    return "\n".join(parts).rstrip()


def labels_table():
    """Return the table of labels per second on a GPU."""
    notes, rows = read_figures("labels")
    table = [
        "| points | million/s | with transfers | compared | wrong signs | distances off by |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        speeds = (f"{float(row[k]) / 1e6:.3g}" for k in ("per_s", "with_transfers_per_s"))
        cells = [row["points"], *speeds, f"{int(row['compared']):,}", row["signs"]]
        table.append(_row([*cells, f"{float(row['off']):.1e}"]))
    return _noted(table, notes)


def _short(text):
    """Format a percentage; values below 1e-9 are rounding errors, and are written as 0."""
    value = float(text or 0)
    return "0" if value < 1e-9 else f"{value:.2g}" if value < 99.5 else f"{value:.4g}"


def native_table():
    """Return the table of single-query times of pandis.h and of the usual implementations."""
    notes, rows = read_figures("native")
    table = [
        "| field | queried by | median (µs) | p99.9 (µs) | ratio to pandis.h |",
        "|---|---|--:|--:|--:|",
    ]
    for row in rows:
        if row["way"].startswith("floor") and "network" not in row["field"]:
            continue  # far below every query
        cells = [row["field"], row["way"], f"{float(row['median_us']):.3g}"]
        cells.append(f"{float(row['p999_us']):.3g}" if row["p999_us"] else "")
        cells.append(f"{float(row['of_native']):.2g}")
        table.append(_row(cells))
    return _noted(table, notes)


def front_table():
    """Return the table of the six meshes' fronts: time, bytes and error near the surface."""
    notes, rows = read_figures("front")
    meshes = list(dict.fromkeys(row["mesh"] for row in rows))
    table = [
        "| field | KB | one query (µs) | " + " | ".join(meshes) + " |",
        "|---|--:|--:|" + "--:|" * len(meshes),
    ]
    for field in dict.fromkeys(row["field"] for row in rows if row["bytes"]):
        rows_of_field = [row for row in rows if row["field"] == field]
        cells = [f"`{field}`", _span([float(row["bytes"]) / 1e3 for row in rows_of_field], ",.0f")]
        cells.append(_span([float(row["native_p50_us"]) for row in rows_of_field], ".2g"))
        for row in rows_of_field:
            error = f"{1e3 * float(row['shallow_mean']):.3g}"
            cells.append(f"**{error}**" if row["front"] else error)
        table.append(_row(cells))
    return _noted(table, notes)


def _span(values, form):
    low, high = format(min(values), form), format(max(values), form)
    return low if low == high else f"{low}–{high}"


def scene_table():
    """Return the table of scenes of many objects."""
    notes, rows = read_figures("scenes")
    table = [
        "| field | objects | median (µs) | p99.9 (µs) | queries per tick | ratio to one object |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        count = "one in contact" if row["scene"] == "one in contact" else f"{int(row['objects']):,}"
        cells = [row["field"], count, f"{float(row['median_us']):.2g}"]
        cells += [f"{float(row['p999_us']):.3g}", f"{float(row['asked']):.2g}"]
        table.append(_row([*cells, f"{float(row['of_one']):.2g}"]))
    return _noted(table, notes)


def touched_table():
    """Return the table of scenes with proxies, against penalty forces."""
    notes, rows = read_figures("touched")
    table = [
        "| fields | touching | queries per tick | median, proxies and penalty (µs) | mean | p99.9 "
        "| ticks compared | different |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        cells = [row["field"], f"{100 * float(row['touching']):.0f} %"]
        cells.append(f"{float(row['queries']):.2g}")
        for key in ("median_us", "mean_us", "p999_us"):
            cells.append(f"{float(row[key]):.2g} and {float(row[f'penalty_{key}']):.2g}")
        table.append(_row([*cells, f"{int(row['ticks']):,}", row["different"]]))
    return _noted(table, notes)


def servo_table():
    """Return the table of one-minute runs at 1 kHz."""
    notes, rows = read_figures("servo")
    table = [
        "| field | load | computing, p50 (µs) | p99.9 | max | missed (%) | starts late, p99.9 (µs) "
        "| max | past the deadline (%) |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        cells = [f"`{row['field']}`" if row["field"] != "clock alone" else row["field"]]
        cells.append(row["load"])
        for key in ("compute_p50_us", "compute_p999_us", "compute_max_us"):
            cells.append(f"{float(row[key]):.3g}" if row["field"] != "clock alone" else "")
        cells.append(f"{100 * float(row['missed']):.2g}")
        cells += [f"{float(row[key]):.3g}" for key in ("late_p999_us", "late_max_us")]
        cells.append(f"{100 * float(row['late']):.2g}")
        table.append(_row(cells))
    return _noted(table, notes)
