"""Numbers that are the same on every machine: by + - × ÷ √ alone, each rounded once, in an order that is written down."""
