"""condyn_pin with ``engine="core"``: the same tick in the compiled core, its proof included."""

from __future__ import annotations

from functools import partial

import condyn_pin as cp
from peers.control.harness import main
from peers.control.with_condyn import contender

if __name__ == "__main__":
    main("condyn_pin's core", cp.__version__, partial(contender, engine="core"))
