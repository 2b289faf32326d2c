"""Computes poses and twists of all bodies, prescribed in closed form or by MuJoCo."""
