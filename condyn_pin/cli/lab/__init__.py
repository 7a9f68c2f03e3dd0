"""The commands of `condyn lab`, one file each, as in `condyn_pin.cli.commands`."""
