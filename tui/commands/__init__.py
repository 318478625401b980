"""What a person touches: the `bumpbench` command line."""
