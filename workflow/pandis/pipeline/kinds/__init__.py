"""The kinds of fields: one folder each, with the modules below; what they share lies beside them.

``spec``
    `KIND`, a `pandis.pipeline.run.ask.kind.Kind`: names, options, colours. Planning reads it, so it
    imports neither NumPy nor more.
``build``, ``search``
    ``build(job)`` makes the artifact, of a given size or of one that is searched, and writes it.
``reference``
    ``open_field(spec, artifact)`` returns the `pandis.pipeline.kinds.field.Field` that a file is
    compared with.
``file``
    ``File``, a `pandis.pipeline.kinds.native.FieldFile`: what a ``.pandis`` file holds of it.
``exports``
    ``EXPORTS``, by ending: functions that write files for other runtimes.
``choice``
    ``choose(chooser)`` returns the `pandis.pipeline.kinds.sizing.Outcome` of the first field that
    meets the budget of `pandis.pipeline.judge.choice.Chooser`, or None; ``timed(torus)`` yields
    form, size and maker of fields whose queries `snakemake -j1 -f calibrate` times.

Only ``spec`` has to be there: a kind without ``file`` is kept only for comparison (its
`pandis.pipeline.run.ask.kind.FieldSpec` then says ``native=False``), one without ``search`` has no
`…-auto`, and `fields: auto` tries those whose `Kind.chosen` says so. Folders do not import each
other.
"""
