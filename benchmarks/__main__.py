"""This is where every benchmark is run: `make bench`."""

from benchmarks import broadband_speed, twin_speed


def main() -> None:
    """Run all benchmarks and print their tables."""
    twin_speed.main()
    broadband_speed.main()


if __name__ == "__main__":
    main()
