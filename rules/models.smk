rule train:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
        samples="<results>/{mesh}/samples.zarr.zip",
    output:
        "<results>/{mesh}/model-{recipe}.zarr.zip",
    log:
        "<results>/logs/{mesh}/train-{recipe}.log",
    benchmark:
        "<results>/benchmarks/{mesh}/train-{recipe}.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    threads: plan.train_threads
    resources:
        mem_mb=3000,
        runtime=720,
        gpu=plan.train_gpus,
    params:
        options=plan.options("train"),
        code=plan.code("train"),
    message:
        "{wildcards.mesh}: train {wildcards.recipe}"
    script:
        "../scripts/train.py"


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
        "../workflow/envs/pandis.yaml"
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


rule choose:
    input:
        mesh="<results>/{mesh}/mesh.zarr.zip",
        times=plan.query_times,
    output:
        "<results>/{mesh}/choice.zarr.zip",
    log:
        "<results>/logs/{mesh}/choose.log",
    benchmark:
        "<results>/benchmarks/{mesh}/choose.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    threads: 2
    resources:
        mem_mb=4000,
        runtime=720,
    params:
        options=plan.options("choose"),
        code=plan.code("choose"),
    message:
        "{wildcards.mesh}: build the cheapest field that meets the budget"
    script:
        "../scripts/choose.py"


rule calibrate:
    output:
        "<results>/query-times.csv",
    log:
        "<results>/logs/calibrate.log",
    benchmark:
        "<results>/benchmarks/calibrate.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    threads: all_cores
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        options=plan.options("calibrate"),
        code=plan.code("calibrate"),
    message:
        "time every kind of field on this machine"
    script:
        "../scripts/calibrate.py"
