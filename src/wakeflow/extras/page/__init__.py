"""The page to work with: ``wakeflow open`` serves it to the browser of this machine."""
