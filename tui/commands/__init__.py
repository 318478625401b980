"""The commands of `bumpbench`, one file each."""
