"""To be run inside desktop Slicer: the panel is made, and its timer shows a status."""

import unittest

import slicer


class MarginGuardPanelTest(unittest.TestCase):
    """Slicer's own widgets, which the tests outside of Slicer stand in for."""

    def test_the_panel_is_made_and_says_that_nothing_is_known(self):
        """Every handler is connected in ``setup``: a name that is wrong would raise there."""
        widget = slicer.util.getNewModuleWidget("MarginGuard")
        try:
            widget.spin()
            self.assertEqual(widget.ui.bannerLabel.text[:7], "UNKNOWN")
            self.assertFalse(widget.ui.playButton.enabled)
        finally:
            widget.cleanup()
