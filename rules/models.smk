rule train:
    input:
        mesh="results/{mesh}/mesh.zarr.zip",
        samples="results/{mesh}/samples.zarr.zip",
    output:
        "results/{mesh}/model-{recipe}.zarr.zip",
    log:
        "results/logs/{mesh}/train-{recipe}.log",
    benchmark:
        "results/benchmarks/{mesh}/train-{recipe}.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    threads: plan.train_threads
    resources:
        mem_mb=3000,
        runtime=240,
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
        model="results/{mesh}/model-{recipe}.zarr.zip",
    output:
        "results/{mesh}/export/{recipe}.onnx",
        "results/{mesh}/export/{recipe}.pt2",
    log:
        "results/logs/{mesh}/export-{recipe}.log",
    benchmark:
        "results/benchmarks/{mesh}/export-{recipe}.jsonl"
    conda:
        "../workflow/envs/pandis.yaml"
    resources:
        mem_mb=2000,
        runtime=15,
    params:
        options=plan.options("export_network"),
        code=plan.code("export_network"),
    message:
        "{wildcards.mesh}: export {wildcards.recipe}, compare it with PyTorch"
    script:
        "../scripts/export_network.py"
