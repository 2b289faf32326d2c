"""Renders scene-linear HDR keyframes with exact depth, ids, normals and motion."""
