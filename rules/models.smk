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
    priority: plan.train_priority
    conda:
        "../workflow/envs/models.yaml"
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
