"""Control: laws, paths, observers and shapers, one file each, found through registries."""
