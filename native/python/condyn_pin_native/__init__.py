"""The compiled core of condyn_pin; `condyn_pin.Native` is what uses it."""
