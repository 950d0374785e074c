rule export_network:
    input:
        model="<results>/{mesh}/model-{recipe}.zarr.zip",
    output:
        "<results>/{mesh}/export/{recipe}.onnx",
        "<results>/{mesh}/export/{recipe}.pt2",
    log:
        "<results>/logs/{mesh}/export-{recipe}.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-{recipe}.jsonl"
    conda:
        "../workflow/envs/exports.yaml"
    resources:
        mem_mb=5000,
        runtime=15,
    params:
        options=plan.options("export_network"),
        code=plan.code("export_network"),
    message:
        "{wildcards.mesh}: export {wildcards.recipe}, compare it with PyTorch"
    script:
        "../scripts/export_network.py"


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
        "../workflow/envs/exports.yaml"
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
        "../workflow/envs/exports.yaml"
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


rule export_page:
    input:
        exports=plan.touchable,
    output:
        "<results>/{mesh}/export/touch.html",
    log:
        "<results>/logs/{mesh}/export-page.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-page.jsonl"
    conda:
        "../workflow/envs/exports.yaml"
    resources:
        mem_mb=2000,
        runtime=15,
    params:
        options=plan.options("export_page"),
        code=plan.code("export_page"),
    message:
        "{wildcards.mesh}: write a page to touch its fields on"
    script:
        "../scripts/export_page.py"


rule export_native:
    input:
        held=plan.native_artifact,
        mesh="<results>/{mesh}/mesh.zarr.zip",
    output:
        "<results>/{mesh}/export/{name}.pandis",
    log:
        "<results>/logs/{mesh}/export-{name}-native.log",
    benchmark:
        "<results>/benchmarks/{mesh}/export-{name}-native.jsonl"
    conda:
        "../workflow/envs/exports.yaml"
    resources:
        mem_mb=2000,
        runtime=15,
    params:
        options=plan.options("export_native"),
        code=plan.code("export_native"),
    message:
        "{wildcards.mesh}: export {wildcards.name} for pandis.h and compare it with the library"
    script:
        "../scripts/export_native.py"
