"""Problems with closed forms or published figures, for the tests and `stickslip verify`."""
