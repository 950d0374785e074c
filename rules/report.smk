rule summary:
    input:
        evaluations=plan.results("evaluation.zarr.zip"),
        timings=plan.results("timing.zarr.zip"),
        stresses=plan.results("stress.zarr.zip"),
        hardware=plan.results("hardware.zarr.zip"),
    output:
        report(
            "<results>/summary.csv",
            caption="../workflow/report/summary.rst",
            category="Summary",
        ),
    log:
        "<results>/logs/summary.log",
    benchmark:
        "<results>/benchmarks/summary.jsonl"
    conda:
        "../workflow/envs/report.yaml"
    resources:
        mem_mb=2000,
        runtime=15,
    params:
        options=plan.options("summary"),
        code=plan.code("summary"),
    message:
        "all meshes: write the summary"
    script:
        "../scripts/summary.py"


rule report:
    input:
        plan.report_artifacts(),
    output:
        report(
            "<results>/report.html",
            caption="../workflow/report/report.rst",
            category="Report",
        ),
    log:
        "<results>/logs/report.log",
    benchmark:
        "<results>/benchmarks/report.jsonl"
    conda:
        "../workflow/envs/report.yaml"
    threads: 4
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        options=plan.options("report"),
        code=plan.code("report"),
    message:
        "all meshes: write the report"
    script:
        "../scripts/report.py"


rule collection:
    input:
        plan.report_artifacts(),
    output:
        "<results>/collection.html",
        "<results>/collection.csv",
    log:
        "<results>/logs/collection.log",
    benchmark:
        "<results>/benchmarks/collection.jsonl"
    conda:
        "../workflow/envs/report.yaml"
    threads: 4
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        options=plan.options("collection"),
        code=plan.code("collection"),
    message:
        "all meshes: write the collection's table and page"
    script:
        "../scripts/collection.py"


rule verify:
    log:
        "<results>/logs/verify.log",
    conda:
        "../workflow/envs/report.yaml"
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        options=plan.options("verify"),
        code=plan.code("verify"),
    message:
        "all meshes: check every result against the configuration and the code"
    script:
        "../scripts/verify.py"
