"""Numerics with the same bits on every machine: only + - × ÷ √, each rounded once, in a fixed order."""
