"""The arithmetic of some passes in what people compute pictures with; optional installs, imported when asked for."""
