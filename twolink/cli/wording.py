"""Wording of Python in the syntax of the command line: arguments become options."""

import re

REPORTED = {"root": "--root", "mimic": "--mimic", "package_dirs": "--package-dir", "losses": "--losses",
            "lock": "--lock", "purpose": "--purpose"}  # fmt: skip
"""What load reports advise, and findings of lint."""


def spoken(text: str, options: dict[str, str]) -> str:
    """A text in which arguments of Python are options: duration=2 is --duration 2, lock={'elbow': 0} --lock elbow=0."""

    def option(found: re.Match[str]) -> str:
        name, value = found.groups()
        if name not in options:
            return found[0]
        if value in ("True", "False"):
            return f"{'no ' * (value == 'False' and not options[name].startswith('--no-'))}{options[name]}"
        if pairs := re.findall(r"""["']([^"']+)["']: (?:\[([^]]*)\]|([^,}]+))""", value):
            return " ".join(f'{options[name]} "{key}={many}"' if many else f"{options[name]} {key}={entry}"
                            for key, many, entry in pairs)  # fmt: skip
        items = re.findall(r"""["']([^"']+)["']""", value)
        return f"{options[name]} {','.join(items) or value}".rstrip()

    text = re.sub(r'\bload_robot\("([^"]*)"\)', r"\1", text)
    if "html" in options:
        text = text.replace('run.playback("motion.html")', "--html motion.html")
    return re.sub(r"\b(\w+)=(\{[^}]*\}|\[[^]]*\]|[^\s,;)]*)", option, text)
