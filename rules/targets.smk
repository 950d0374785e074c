# Targets that can be requested by name; see workflow/pandis/pipeline/run/plan/stages.py.
rule meshes:
    input:
        plan.target("meshes"),
    message:
        "meshes: every result is there"


rule samples:
    input:
        plan.target("samples"),
    message:
        "samples: every result is there"


rule models:
    input:
        plan.target("models"),
    message:
        "models: every result is there"


rule exports:
    input:
        plan.target("exports"),
    message:
        "exports: every result is there"


rule grids:
    input:
        plan.target("grids"),
    message:
        "grids: every result is there"


rule evaluations:
    input:
        plan.target("evaluations"),
    message:
        "evaluations: every result is there"


rule hardware:
    input:
        plan.target("hardware"),
    message:
        "hardware: every result is there"


rule scenes:
    input:
        plan.target("scenes"),
    message:
        "scenes: every result is there"
