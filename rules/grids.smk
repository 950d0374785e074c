rule bake:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/grid-{content}-{size}.zarr.zip",
    log:
        "<results>/logs/{mesh}/bake-{content}-{size}.log",
    benchmark:
        "<results>/benchmarks/{mesh}/bake-{content}-{size}.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    threads: 2
    resources:
        mem_mb=4000,
        runtime=120,
    params:
        options=plan.options("bake"),
        code=plan.code("bake"),
    message:
        "{wildcards.mesh}: bake {wildcards.size}³ nodes of {wildcards.content}"
    script:
        "../scripts/bake.py"


rule bake_spline:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/grid-spline-{size}.zarr.zip",
    log:
        "<results>/logs/{mesh}/bake-spline-{size}.log",
    benchmark:
        "<results>/benchmarks/{mesh}/bake-spline-{size}.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    threads: 2
    resources:
        mem_mb=4000,
        runtime=120,
    params:
        options=plan.options("bake_spline"),
        code=plan.code("bake_spline"),
    message:
        "{wildcards.mesh}: fit a spline of {wildcards.size}³ nodes"
    script:
        "../scripts/bake_spline.py"


rule bake_auto:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/grid-{kind}-auto.zarr.zip",
    log:
        "<results>/logs/{mesh}/bake-{kind}-auto.log",
    benchmark:
        "<results>/benchmarks/{mesh}/bake-{kind}-auto.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    threads: 2
    resources:
        mem_mb=4000,
        runtime=120,
    params:
        options=plan.options("bake_auto"),
        code=plan.code("bake_auto"),
    message:
        "{wildcards.mesh}: find the size of {wildcards.kind}-auto"
    script:
        "../scripts/bake_auto.py"


rule export_grid:
    input:
        grid=plan.grid_artifact,
    output:
        "<results>/{mesh}/export/{field}.onnx",
    log:
        "<results>/logs/{mesh}/export-{field}.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-{field}.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    resources:
        mem_mb=4000,
        runtime=15,
    params:
        options=plan.options("export_grid"),
        code=plan.code("export_grid"),
    message:
        "{wildcards.mesh}: export {wildcards.field} and compare it with the library"
    script:
        "../scripts/export_grid.py"


rule export_vti:
    input:
        grid=plan.grid_artifact,
    output:
        "<results>/{mesh}/export/{field}.vti",
    log:
        "<results>/logs/{mesh}/export-{field}-vti.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-{field}-vti.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    resources:
        mem_mb=4000,
        runtime=15,
    params:
        options=plan.options("export_vti"),
        code=plan.code("export_vti"),
    message:
        "{wildcards.mesh}: write {wildcards.field} as VTK image data"
    script:
        "../scripts/export_vti.py"


rule support_planes:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/method-support-planes.zarr.zip",
    log:
        "<results>/logs/{mesh}/support-planes.log",
    benchmark:
        "<results>/benchmarks/{mesh}/support-planes.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    threads: 2
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        options=plan.options("support_planes"),
        code=plan.code("support_planes"),
    message:
        "{wildcards.mesh}: lay support planes"
    script:
        "../scripts/support_planes.py"
