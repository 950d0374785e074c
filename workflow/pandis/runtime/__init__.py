"""What answers from a ``.pandis`` file: fields, contacts, scenes, poses, servo loops, devices."""
