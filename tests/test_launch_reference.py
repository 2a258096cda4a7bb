from pathlib import Path

from forcebound.config.schema import reference_page

PAGE = Path(__file__).parent.parent / "docs" / "launch-files.md"


def test_the_page_of_keys_is_current() -> None:
    told = "make it anew: forcebound schema --page > docs/launch-files.md"
    assert PAGE.read_text(encoding="utf-8") == reference_page(), told
