# Targets that can be requested by name; see workflow/pandis/pipeline/run/plan/stages.py.
rule meshes:
    input:
        plan.target("meshes"),
    message:
        "meshes: all results exist"


rule samples:
    input:
        plan.target("samples"),
    message:
        "samples: all results exist"


rule models:
    input:
        plan.target("models"),
    message:
        "models: all results exist"


rule exports:
    input:
        plan.target("exports"),
    message:
        "exports: all results exist"


rule grids:
    input:
        plan.target("grids"),
    message:
        "grids: all results exist"


rule evaluations:
    input:
        plan.target("evaluations"),
    message:
        "evaluations: all results exist"


rule hardware:
    input:
        plan.target("hardware"),
    message:
        "hardware: all results exist"


rule scenes:
    input:
        plan.target("scenes"),
    message:
        "scenes: all results exist"


rule datasets:
    input:
        plan.target("datasets"),
    message:
        "datasets: all results exist"
