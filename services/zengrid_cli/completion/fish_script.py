"""The completion script for fish."""

from __future__ import annotations

from collections.abc import Sequence

from zengrid_cli.completion.completion_table import CompletedArgument, CompletedCommand

_PATHS = """\
# Completion of zengrid for fish. Load it with: zengrid completion fish | source
function __zengrid_path
    set -l path
    for word in (commandline -opc)[2..-1]
        switch "$path $word"
            case {paths}
                set path "$path $word"
        end
    end
    echo "/$path"
end
complete -c zengrid -f
"""


def fish_script(commands: Sequence[CompletedCommand]) -> str:
    """Write the completion script."""
    paths = " ".join(_quote(f" {command.path}") for command in commands if command.path)
    lines = [_PATHS.format(paths=paths)]
    for command in commands:
        path = f"/ {command.path}" if command.path else "/"
        condition = f"complete -c zengrid -n {_quote(f'contains -- {_quote(path)} (__zengrid_path)')}"
        for name, help in command.subcommands.items():
            lines.append(f"{condition} -a {name} -d {_quote(help)}\n")
        offered = [argument for argument in command.positional if argument.values or argument.files]
        lines += [f"{condition}{_values(argument)}\n" for argument in offered]
        for option in command.options:
            names = "".join(f" -l {name[2:]}" if name.startswith("--") else f" -s {name[1:]}" for name in option.names)
            value = f" -r{_values(option)}" if option.takes_value else ""
            lines.append(f"{condition}{names}{value} -d {_quote(option.help)}\n")
    return "".join(lines)


def _values(argument: CompletedArgument) -> str:
    values = f" -a {_quote(' '.join(argument.values))}" if argument.values else ""
    return f"{values} {'-F' if argument.files else '-f'}"


def _quote(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"
