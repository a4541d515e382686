"""What other packages bring: robots, devices, materials and estimators, by entry points.

A package names what it brings in its own ``pyproject.toml``; nothing is imported, and no package looked through, before
a name is asked for that is not built in.
"""

from foretouch.plugins.loading import (
    GROUPS,
    Plugin,
    PluginError,
    all_plugins,
    find_plugin,
    load_plugin,
    make_plugin,
    plugin_names,
    plugins_named,
    problem_of,
)

__all__ = [
    "GROUPS",
    "Plugin",
    "PluginError",
    "all_plugins",
    "find_plugin",
    "load_plugin",
    "make_plugin",
    "plugin_names",
    "plugins_named",
    "problem_of",
]
