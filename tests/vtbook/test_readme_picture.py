"""The README's picture is drawn from the stored runs."""

from vtbook.readme_picture import FILE, picture


def test_the_picture_is_drawn_from_the_stored_runs():
    assert FILE.read_text(encoding="utf-8") == picture()
