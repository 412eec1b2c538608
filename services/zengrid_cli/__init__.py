"""The command line: everything `zengrid` can be told to do."""
