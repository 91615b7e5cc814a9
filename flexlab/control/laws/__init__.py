"""The control laws, one file each: model, kernel, memory, fastest rate. See `flexlab.control.law`."""
