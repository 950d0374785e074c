"""Everything that answers from a ``.pandis`` file: from fields and contacts to servo loops."""
