"""The bench that the doctor is called to in his tests, in virtual time."""

from tests.unit.emulator_stand_in import Bench, paper_rig

from sinew.bench.doctor import Finding, Severity, apply_fixes, call_roll, examine_motors, list_fixes
from sinew.hardware.rig import Rig


class Ward(Bench):
    """A bench with a rig on it, its sensor upright."""

    def __init__(self, wiring: dict[str, object] | None = None, **rig: object) -> None:
        super().__init__(paper_rig(), retries=1, imu_ppm=0.0, **rig)
        self.plant.acceleration = (9.80665, 0.0, 0.0)
        self.rigged = Rig(self.bus, self.port, paper_rig(**(wiring or {})))

    def findings(self) -> list[Finding]:
        roll = call_roll(self.rigged)
        return roll.findings + examine_motors(self.rigged, roll)

    def about(self, subject: str, *severities: Severity) -> list[str]:
        return [f.found for f in self.findings() if f.subject == subject and f.severity in severities]

    def fix_all(self) -> list[Finding]:
        return apply_fixes(self.rigged, self.port, list_fixes(self.findings()))

    def registers(self) -> list[bytes]:
        return [bytes(motor.registers.memory[:120]) for motor in self.rig.motors.values()]
