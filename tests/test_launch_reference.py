from pathlib import Path

from forcebound.config.schema import reference_page

PAGE = Path(__file__).parent.parent / "docs" / "launch-files.md"


def test_the_page_of_keys_is_current() -> None:
    assert PAGE.read_text(encoding="utf-8") == reference_page(), "to write it: make reference"
