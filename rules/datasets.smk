rule shard:
    output:
        "<results>/datasets/{dataset}/shards/{shard}.zarr.zip",
    log:
        "<results>/logs/datasets/{dataset}/{shard}.log",
    benchmark:
        "<results>/benchmarks/datasets/{dataset}/{shard}.jsonl"
    conda:
        "../workflow/envs/datasets.yaml"
    threads: 2
    resources:
        mem_mb=8000,
        runtime=240,
    params:
        options=plan.options("shard"),
        code=plan.code("shard"),
    message:
        "{wildcards.dataset}: label the meshes of shard {wildcards.shard}"
    script:
        "../scripts/shard.py"


rule dataset:
    input:
        plan.datasets.shards,
    output:
        "<results>/datasets/{dataset}/index.zarr.zip",
        "<results>/datasets/{dataset}/card.html",
        "<results>/datasets/{dataset}/card.json",
    log:
        "<results>/logs/datasets/{dataset}/dataset.log",
    benchmark:
        "<results>/benchmarks/datasets/{dataset}/dataset.jsonl"
    conda:
        "../workflow/envs/datasets.yaml"
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        options=plan.options("dataset"),
        code=plan.code("dataset"),
    message:
        "{wildcards.dataset}: write the index and the card"
    script:
        "../scripts/dataset.py"
