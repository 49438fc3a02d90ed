"""The process that the kill test kills: it writes a run at 200 Hz and says how many samples it handed over."""

import os
import sys
import time
from pathlib import Path

from tests.unit.bench_journal import PLAN, PLAN_TEXT, RIG_TEXT, Node, cycles

from sinew.bench.record.journal import Journal


def main(path: Path) -> None:
    journal = (
        Journal.open(path, PLAN_TEXT, RIG_TEXT) if path.exists() else Journal.create(path, PLAN_TEXT, RIG_TEXT, {})
    )
    begin = time.monotonic()
    count = 0
    while True:
        todo = [i for i in range(len(PLAN.groups())) if i not in journal.finished_groups()]
        index = todo[0] if todo else 1  # with nothing left to do it measures a group again
        group = PLAN.groups()[index]
        settle, record = group.sample_counts(PLAN.sample_hz)
        samples = cycles(group, begin + count / 200, Node(), count)
        for number, sample in enumerate(samples):
            if number in (0, settle):
                journal.begin_segment(index, 0, group.segment("settle" if number < settle else group.kind))
            time.sleep(max(0.0, begin + count / 200 - time.monotonic()))
            journal.append(sample)
            count += 1
            os.write(1, b"%d\n" % count)
            if number in (settle - 1, settle + record - 1):
                journal.end_segment("complete")
            if number == settle + record - 1:
                journal.finish_group(index)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
