"""Kinds of fields: one folder each, with the modules below. Shared modules are beside the folders.

``spec``
    `KIND`, a `pandis.pipeline.run.ask.kind.Kind`: names, options, colours. Planning reads it, so it
    must not import large packages such as NumPy.
``build``, ``search``
    ``build(job)`` writes the artifact; its size is given (``build``) or searched for (``search``).
``reference``
    ``open_field(spec, artifact)`` returns the `pandis.pipeline.kinds.field.Field` that a file is
    compared with.
``file``
    ``File``, a `pandis.pipeline.kinds.native.FieldFile`: the contents of its ``.pandis`` file.
``exports``
    ``EXPORTS``: functions, by extension, that write files for other runtimes.
``choice``
    ``choose(chooser)`` returns the `pandis.pipeline.kinds.sizing.Outcome` of the first field that
    meets the budget of `pandis.pipeline.judge.choice.Chooser`, or None; ``timed(torus)`` yields the
    fields whose queries `snakemake -j1 -f calibrate` times: for each, its form, its size and a
    function that makes it.

Only ``spec`` is required. A kind without ``file`` is kept only for comparison (its
`pandis.pipeline.run.ask.kind.FieldSpec` has ``native=False``). A kind without ``search`` has no
`…-auto` fields. `fields: auto` tries the kinds whose `Kind.chosen` is true. No folder imports
another.
"""
