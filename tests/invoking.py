"""The command line, in the process of a test."""

from click.testing import CliRunner, Result

from forcebound.cli import main


def invoke(*words: object) -> Result:
    """Run a command; errors that are no messages raise."""
    return CliRunner().invoke(main, [str(word) for word in words], catch_exceptions=False)
