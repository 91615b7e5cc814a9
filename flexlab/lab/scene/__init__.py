"""The picture in the browser: the drawn parts, the overlays and the cameras."""
