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
    # all cores: nothing else of this run may disturb the clock
    threads: all_cores
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        options=plan.options("scene"),
        code=plan.code("scene"),
    message:
        "scene {wildcards.scene}: go through it and compare with asking every object"
    script:
        "../scripts/scene.py"
