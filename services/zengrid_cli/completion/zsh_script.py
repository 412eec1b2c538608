"""The completion script for zsh."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from zengrid_cli.completion.completion_table import CompletedArgument, CompletedCommand

_SCRIPT = """\
#compdef zengrid
# Completion of zengrid for zsh. Load it with: source <(zengrid completion zsh)
_zengrid() {{
    local current=$words[CURRENT] previous=$words[CURRENT-1] place= files= index
    local -a options values
    for ((index = 2; index < CURRENT; index++)); do
        case "$place $words[index]" in
{paths}
        esac
    done
    if [[ $current == --*=* ]]; then
        previous=${{current%%=*}}
        compset -P '*='
        current=$PREFIX
    fi
    case "$place $previous" in
{values}
        *)
            case "$place" in
{commands}
            esac
            ;;
    esac
    if [[ $current == -* ]]; then
        _describe -o option options
        return
    fi
    (( $#values )) && _describe value values
    [[ -n $files ]] && _files
}}
if [[ $funcstack[1] == _zengrid ]]; then
    _zengrid "$@"
else
    compdef _zengrid zengrid
fi
"""


def zsh_script(commands: Sequence[CompletedCommand]) -> str:
    """Write the completion script."""
    paths, values, cases = [], [], []
    for command in commands:
        path = f" {command.path}" if command.path else ""
        if path:
            paths.append(f'            "{path}") place="{path}" ;;')
        for option in command.options:
            if option.takes_value:
                patterns = "|".join(f'"{path} {name}"' for name in option.names)
                values.append(f"        {patterns}) {_assignments((), option.values, option.files)} ;;")
        offered = [f"{name}:{help}" for name, help in command.subcommands.items()]
        offered += [value for argument in command.positional for value in argument.values]
        files = any(argument.files for argument in command.positional)
        cases.append(f'                "{path}") {_assignments(command.options, offered, files)} ;;')
    return _SCRIPT.format(paths="\n".join(paths), values="\n".join(values), commands="\n".join(cases))


def _assignments(options: Iterable[CompletedArgument], values: Iterable[str], files: bool) -> str:
    parts = []
    described = [f"{name}:{option.help}" for option in options for name in option.names]
    for name, items in (("options", described), ("values", list(values))):
        if items:
            parts.append(f"{name}=({' '.join(map(_quote, items))})")
    if files:
        parts.append("files=1")
    return "; ".join(parts) or ":"


def _quote(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"
