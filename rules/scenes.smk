rule scene:
    input:
        fields=plan.scene_fields,
    output:
        "<results>/scenes/{scene}.zarr.zip",
        "<results>/scenes/{scene}.json",
        "<results>/scenes/{scene}.h",
    log:
        "<results>/logs/scenes/{scene}.log",
    benchmark:
        "<results>/benchmarks/scenes/{scene}.jsonl"
    conda:
        "../workflow/envs/scenes.yaml"
    # all cores: no other job of this run may disturb the timing
    threads: all_cores
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        options=plan.options("scene"),
        code=plan.code("scene"),
    message:
        "scene {wildcards.scene}: move a probe through it and compare the forces with those from querying all objects"
    script:
        "../scripts/scene.py"
