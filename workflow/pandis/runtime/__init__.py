"""Everything that uses ``.pandis`` files: from fields and contacts to servo loops."""
