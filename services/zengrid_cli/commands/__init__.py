"""The commands of ``zengrid``: each module has ``parser()`` and ``main(arguments)``."""
