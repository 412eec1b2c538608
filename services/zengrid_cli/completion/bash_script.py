"""The completion script for bash."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence

from zengrid_cli.completion.completion_table import CompletedCommand

_SCRIPT = """\
# Completion of zengrid for bash. Load it with: source <(zengrid completion bash)
_zengrid() {{
    local current=${{COMP_WORDS[COMP_CWORD]}} previous=${{COMP_WORDS[COMP_CWORD-1]}} path= options= values= files= index
    COMPREPLY=()
    for ((index = 1; index < COMP_CWORD; index++)); do
        case "$path ${{COMP_WORDS[index]}}" in
{paths}
        esac
    done
    # bash splits --option=value into three words.
    if [[ $current == = ]]; then
        current=
    elif [[ $previous == = ]]; then
        previous=${{COMP_WORDS[COMP_CWORD-2]}}
    fi
    case "$path $previous" in
{values}
        *)
            case "$path" in
{commands}
            esac
            ;;
    esac
    if [[ $current == -* ]]; then
        mapfile -t COMPREPLY < <(compgen -W "$options" -- "$current")
        return
    fi
    mapfile -t COMPREPLY < <(compgen -W "$values" -- "$current")
    if [[ $files ]]; then
        compopt -o filenames 2>/dev/null
        mapfile -t -O "${{#COMPREPLY[@]}}" COMPREPLY < <(compgen -f -- "$current")
    fi
}}
complete -F _zengrid zengrid
"""


def bash_script(commands: Sequence[CompletedCommand]) -> str:
    """Write the completion script.

    The path of a command has a space before each word, as in `` journal verify``.
    """
    paths, values, cases = [], [], []
    for command in commands:
        path = _path(command)
        if path:
            paths.append(f'            "{path}") path="{path}" ;;')
        for option in command.options:
            if option.takes_value:
                patterns = "|".join(f'"{path} {name}"' for name in option.names)
                values.append(f"        {patterns}) {_assignments((), option.values, option.files)} ;;")
        names = [name for option in command.options for name in option.names]
        offered = [*command.subcommands, *(value for it in command.positional for value in it.values)]
        files = any(argument.files for argument in command.positional)
        cases.append(f'                "{path}") {_assignments(names, offered, files)} ;;')
    return _SCRIPT.format(paths="\n".join(paths), values="\n".join(values), commands="\n".join(cases))


def _path(command: CompletedCommand) -> str:
    return f" {command.path}" if command.path else ""


def _assignments(options: Iterable[str], values: Iterable[str], files: bool) -> str:
    parts = []
    for name, words in (("options", options), ("values", values)):
        text = " ".join(words)
        if text:
            parts.append(f"{name}={shlex.quote(text)}")
    if files:
        parts.append("files=1")
    return " ".join(parts) or ":"
