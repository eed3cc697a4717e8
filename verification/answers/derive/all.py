"""Checks the formulas, writes every known answer again, and reads the scenes. Needs Python 3.11 or newer and mpmath; takes about a
minute."""

import check_scenes
import check_springs
import critical_steps
import damped_spring
import hanging_chain
import invariants
import one_step
import spring_blocks
import taut_chain
import trajectories
import two_bodies
import wmethod

if __name__ == "__main__":
    for script in (check_springs, one_step, spring_blocks, damped_spring, taut_chain, hanging_chain, two_bodies, trajectories,
                   critical_steps, invariants, wmethod, check_scenes):
        script.main()
