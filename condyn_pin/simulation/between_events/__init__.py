"""Motion between events of contacts, and what happens at them: at work behind `EventDriven`.

Knows: the equations of motion with contacts at one state (`ContactTerms`), what they do while no
contact changes its mode (`ModeDynamics`), segments of motion up to the first margin that falls to
zero (`Segments`), and the modes, impacts and shocks with which the next one begins (`Transition`).
Must not know: schemes with steps of one size.
"""
