"""Runs inside desktop Slicer: creates the panel and checks the status that its timer shows."""

import unittest

import slicer


class MarginGuardPanelTest(unittest.TestCase):
    """Uses Slicer's own widgets, which tests outside of Slicer replace by doubles."""

    def test_new_panel_shows_unknown(self):
        """``setup`` connects every handler, and raises for a wrong name."""
        widget = slicer.util.getNewModuleWidget("MarginGuard")
        try:
            widget.refresh()
            self.assertEqual(widget.ui.bannerLabel.text[:7], "UNKNOWN")
            self.assertFalse(widget.ui.playButton.enabled)
        finally:
            widget.cleanup()
