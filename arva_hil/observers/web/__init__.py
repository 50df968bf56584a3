"""The page about a run in a browser: `page.WebPage` observes events, and serves them on a local address."""
