"""The picture in the browser: what is drawn and where it stands."""
