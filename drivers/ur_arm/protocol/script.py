"""Lines of URScript that the driver sends (§4); a line is a program of its own.

Sections (§) are those of ur.md.
"""

from collections.abc import Iterable

__all__ = ["freedrive", "movej", "set_payload", "set_tcp", "stopj"]


def movej(q_rad: Iterable[float], acceleration_rad_s2: float, speed_rad_s: float) -> bytes:
    """Return the line that moves to joints; both rates are the leading axis' (§4.1).

    Parameters
    ----------
    q_rad : six joints
    acceleration_rad_s2, speed_rad_s : acceleration and speed of the leading axis
    """
    joints = ", ".join(f"{angle:.9f}" for angle in q_rad)
    return f"movej([{joints}], a={acceleration_rad_s2:.6f}, v={speed_rad_s:.6f})\n".encode()


def stopj(deceleration_rad_s2: float) -> bytes:
    """Return the line that stops all joints (§4.2)."""
    return f"stopj({deceleration_rad_s2:.6f})\n".encode()


def freedrive(seconds: float) -> bytes:
    """Return the program that lets the arm be led by hand, for so long at the most (§4.6)."""
    lines = ("def cellctl_freedrive():", "  freedrive_mode()", f"  sleep({seconds:.1f})", "end", "")
    return "\n".join(lines).encode()


def set_payload(mass_kg: float, centre_mm: Iterable[float]) -> bytes:
    """Return the line that sets the mass on the flange, and where it is centred (§4.4).

    Parameters
    ----------
    mass_kg : mass
    centre_mm : three, in the flange's frame
    """
    centre = ", ".join(f"{mm / 1000:.6f}" for mm in centre_mm)
    return f"set_payload({mass_kg:.6f}, [{centre}])\n".encode()


def set_tcp(flange_to_tcp_mm: float) -> bytes:
    """Return the line that sets the TCP on the flange's axis (§4.4)."""
    return f"set_tcp(p[0.0, 0.0, {flange_to_tcp_mm / 1000:.6f}, 0.0, 0.0, 0.0])\n".encode()
