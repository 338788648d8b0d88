"""The method as published and the condensed methods, side by side: what each costs, and how exact it is."""
