"""Which jobs run after which edit of the code: the exact sets, through Snakemake's own dry run."""

from plans import BOTH, DEPENDENT, DOWNSTREAM, EVERYTHING, LAST, all_of, graphs, native
from support import edit, plan


def test_library_module_restales_its_importers_only(rerun):
    edit(rerun / "workflow/pandis/pipeline/geometry/trajectories.py", "_TRIES = 24", "_TRIES = 25")
    assert plan(rerun) == all_of("trajectory", *DOWNSTREAM) | LAST


def test_module_imported_through_another_counts(rerun):
    edit(rerun / "workflow/pandis/pipeline/mesh/tools.py", "OMP_NUM_THREADS", "OMP_THREAD_LIMIT")
    assert plan(rerun) == EVERYTHING


def test_template_counts(rerun):
    edit(
        rerun / "workflow/pandis/pipeline/report/page.html",
        "<h1>pandis report</h1>",
        "<h1>pandis</h1>",
    )
    assert plan(rerun) == LAST


def test_script_edited(rerun):
    edit(rerun / "scripts/timing.py", "for path in", "for path in list() or")
    assert plan(rerun) == all_of("timing") | LAST


def test_field_module_edited_restales_no_other_field(rerun):
    edit(
        rerun / "workflow/pandis/pipeline/kinds/network/training/trainer.py",
        "QUICK = 4000",
        "QUICK = 4001",
    )
    network = {("train", m, "pandis-exact") for m in BOTH} | graphs("pandis-exact")
    network |= native("pandis-exact")
    assert plan(rerun) == network | all_of(*DEPENDENT) | LAST


def test_baking_module_edited_trains_nothing(rerun):
    edit(rerun / "workflow/pandis/pipeline/kinds/grid/dense.py", "(1 << 18)", "(1 << 17)")
    grids = {("bake", m, "grid-force-24") for m in BOTH}
    grids |= graphs("trilinear-24") | native("trilinear-24")
    assert plan(rerun) == grids | all_of(*DEPENDENT) | LAST


def test_grid_module_edited_bakes_and_trains_nothing(rerun):
    edit(
        rerun / "workflow/pandis/pipeline/kinds/grid/interpolation.py",
        "Lattice.around_box(len(self.values) - 1)",
        "Lattice.around_box(+len(self.values) - 1)",
    )
    grids = graphs("trilinear-24") | native("trilinear-24")
    assert plan(rerun) == grids | all_of(*DEPENDENT) | LAST


def test_network_module_edited_bakes_nothing(rerun):
    edit(
        rerun / "workflow/pandis/pipeline/kinds/network/reference.py", "h = np.sin(", "h = +np.sin("
    )
    networks = graphs("pandis-exact") | native("pandis-exact")
    assert plan(rerun) == networks | all_of(*DEPENDENT) | LAST


def test_one_loss_edited_trains_the_other_recipe_not_again(rerun):
    edit(
        rerun / "workflow/pandis/pipeline/kinds/network/training/paper_loss.py",
        "clamp(max=80.0)",
        "clamp(max=81.0)",
    )
    assert plan(rerun) == set()  # the configuration trains pandis-exact alone
    edit(
        rerun / "workflow/pandis/pipeline/kinds/network/training/exact_loss.py",
        "off + options",
        "+off + options",
    )
    network = {("train", m, "pandis-exact") for m in BOTH} | graphs("pandis-exact")
    network |= native("pandis-exact")
    assert plan(rerun) == network | all_of(*DEPENDENT) | LAST


def test_config_module_edited_reruns_nothing(rerun):
    """Options reach a stage through its params: the module that reads them is not a part of it."""
    edit(
        rerun / "workflow/pandis/pipeline/run/ask/reading.py",
        "def merge(base, override):",
        "def merge(base, override=()):",
    )
    assert plan(rerun) == set()


def test_comment_and_docstring_edited(rerun):
    for path in (rerun / "workflow/pandis").rglob("*.py"):
        path.write_text("# a comment\n" + path.read_text() + "\n\n\n")
    edit(rerun / "scripts/mesh.py", '"""Read', '"""Really read')
    assert plan(rerun) == set()
