"""``zengrid completion``: prints a script that completes command lines in a shell."""

from __future__ import annotations

from collections.abc import Sequence

from zengrid.command_line.command_parser import CommandParser


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid completion",
        description="Print a script that completes commands, options and values in your shell.",
        examples=[
            "source <(zengrid completion bash)",
            "zengrid completion bash > ~/.local/share/bash-completion/completions/zengrid",
            "zengrid completion fish > ~/.config/fish/completions/zengrid.fish",
        ],
    )
    it.add_argument("shell", choices=["bash", "zsh", "fish"], help="your shell")
    return it


def main(arguments: Sequence[str]) -> int:
    """Print the script."""
    options = parser().parse_args(arguments)
    from zengrid_cli.completion.bash_script import bash_script
    from zengrid_cli.completion.completion_table import completion_table
    from zengrid_cli.completion.fish_script import fish_script
    from zengrid_cli.completion.zsh_script import zsh_script

    scripts = {"bash": bash_script, "zsh": zsh_script, "fish": fish_script}
    print(scripts[options.shell](completion_table()), end="")
    return 0
