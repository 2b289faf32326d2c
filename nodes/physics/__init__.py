"""Physics: poses and twists of all bodies, prescribed in closed form or computed by MuJoCo."""
