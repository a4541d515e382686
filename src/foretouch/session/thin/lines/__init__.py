"""Commands and telemetry as straight lines, said again where they would be wrong."""
