// SPDX-License-Identifier: Apache-2.0
// The node on a Cortex-M7 in QEMU (mps2-an500): its line on UART 0, a trace on UART 1, time from timer 0.
//
// QEMU's UART has no baud: bytes come when this computer gets round to it. So a test announces on UART 1 how many there
// will be (two bytes, the low one first) and waits for a line `go`; the board gathers them and plays them to the node as fast as the baud has it, in
// QEMU's time. Bytes that were not announced are heard as they come.
//
// The trace has a line for every answer, in hexadecimal microseconds of another timer, which starts with the first:
// when the last byte of the instruction was heard, and when the first byte of the answer was given to the UART. A line
// `ready` says that the node has started.
#include "../host/still_chip.h"
#include "../node/imu_chip.h"
#include "../node/node.h"
#include "../node/slave.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <new>

// Defined by the linker script.
extern uint32_t data_source[], data_start[], data_stop[], bss_start[], bss_stop[], stack_top[];
extern "C" [[noreturn]] void start();

namespace {

using namespace sinew;

constexpr uint32_t kClockHz = 25'000'000;

volatile uint32_t& word_at(uintptr_t address) { return *reinterpret_cast<volatile uint32_t*>(address); }

// Arm CMSDK: a timer that counts down from 2^32 - 1 and begins anew.
class Timer {
public:
    explicit Timer(uintptr_t base) : base_(base) {
        word_at(base_ + kReload) = UINT32_MAX;
        word_at(base_ + kValue) = UINT32_MAX;
        word_at(base_ + kControl) = 1;
    }
    // Must be asked at least every 171 s.
    uint32_t micros() {
        const uint32_t value = word_at(base_ + kValue);
        ticks_ += last_ - value;
        last_ = value;
        return static_cast<uint32_t>(ticks_ / (kClockHz / 1'000'000));
    }

private:
    static constexpr uintptr_t kControl = 0x0, kValue = 0x4, kReload = 0x8;
    uintptr_t base_;
    uint32_t last_ = UINT32_MAX;
    uint64_t ticks_ = 0;
};

class Uart {
public:
    explicit Uart(uintptr_t base) : base_(base) {
        word_at(base_ + kBaudDivider) = 16;
        word_at(base_ + kControl) = 3;
    }
    int read() { return word_at(base_ + kState) & 2 ? static_cast<int>(word_at(base_ + kData) & 0xFF) : -1; }
    void write(uint8_t byte) {
        while (word_at(base_ + kState) & 1) {}
        word_at(base_ + kData) = byte;
    }
    // QEMU's line has no baud: bytes pass as they are read.
    void set_baud(uint32_t baud) { word_at(base_ + kBaudDivider) = std::max<uint32_t>(16, kClockHz / baud); }

private:
    static constexpr uintptr_t kData = 0x0, kState = 0x4, kControl = 0x8, kBaudDivider = 0x10;
    uintptr_t base_;
};

struct Kept {
    uint32_t mark;
    uint8_t bytes[16];
};
constexpr uint32_t kKeptMark = 0x6B657074;
[[gnu::section(".kept")]] Kept kept;

class QemuBoard final : public Clock, public Wire, public Store, public sinew::Board {
public:
    uint32_t micros() override { return clock_.micros(); }

    int read() override {
        const int byte = is_announced() ? played() : line_.read();
        if (byte >= 0) heard_us_ = trace_clock_.micros();
        return byte;
    }
    void write(const uint8_t* bytes, size_t size) override {
        const uint32_t spoke_us = trace_clock_.micros();
        for (size_t at = 0; at < size; ++at) line_.write(bytes[at]);
        say(heard_us_, ' ');
        say(spoke_us, '\n');
    }
    void set_baud(uint32_t baud) override {
        baud_ = baud;
        line_.set_baud(baud);
    }

    bool load(uint8_t* bytes, size_t size) override {
        if (kept.mark != kKeptMark || size > sizeof kept.bytes) return false;
        std::copy(kept.bytes, kept.bytes + size, bytes);
        return true;
    }
    void save(const uint8_t* bytes, size_t size) override {
        if (size > sizeof kept.bytes) return;
        std::copy(bytes, bytes + size, kept.bytes);
        kept.mark = kKeptMark;
    }

    void restart() override {
        constexpr uintptr_t kReset = 0xE000ED0C;
        word_at(kReset) = 0x05FA0004;
        for (;;) {}
    }
    void say(const char* words) {
        for (; *words != 0; ++words) trace_.write(static_cast<uint8_t>(*words));
    }
    void wait_ms(uint32_t) override {}  // the chip is not there, and has nothing to settle

private:
    bool is_announced() {
        if (announced_ > 0) return true;
        const int byte = trace_.read();
        if (byte < 0) return false;
        if (low_ < 0) {
            low_ = byte;
            return false;
        }
        announced_ = std::min(sizeof bytes_, static_cast<size_t>(low_ | byte << 8));
        low_ = -1;
        gathered_ = played_ = 0;
        say("go\n");
        return announced_ > 0;
    }
    int played() {
        while (gathered_ < announced_) {
            const int byte = line_.read();
            if (byte < 0) return -1;
            bytes_[gathered_++] = static_cast<uint8_t>(byte);
            if (gathered_ == announced_) began_us_ = clock_.micros();
        }
        if (clock_.micros() - began_us_ < (played_ + 1) * 10'000'000u / baud_) return -1;
        const int byte = bytes_[played_++];
        if (played_ == announced_) announced_ = 0;
        return byte;
    }
    void say(uint32_t value, char behind) {
        for (int shift = 28; shift >= 0; shift -= 4) {
            trace_.write(static_cast<uint8_t>("0123456789abcdef"[value >> shift & 0xF]));
        }
        trace_.write(static_cast<uint8_t>(behind));
    }

    Timer clock_{0x40000000};
    Timer trace_clock_{0x40001000};
    Uart line_{0x40004000};
    Uart trace_{0x40005000};
    uint32_t heard_us_ = 0, baud_ = 1'000'000, began_us_ = 0;
    int low_ = -1;
    size_t announced_ = 0, gathered_ = 0, played_ = 0;
    uint8_t bytes_[400] = {};
};

[[noreturn]] void run() {
    static QemuBoard board;
    static StillChip still(board, kMpu9250);
    static Node node(board, board);
    static Chip chip(node, board, still, board);
    static Slave slave(node, board, board, board);
    chip.begin();
    board.say("ready\n");
    for (;;) {
        slave.poll();
        if (!slave.is_busy()) chip.poll();
    }
}

}  // namespace

extern "C" [[noreturn]] void start() {
    constexpr uintptr_t kCoprocessors = 0xE000ED88;
    word_at(kCoprocessors) = 0xF << 20;  // the FPU
    asm volatile("dsb\n isb");
    std::copy(data_source, data_source + (data_stop - data_start), data_start);
    std::fill(bss_start, bss_stop, 0u);
    run();
}

namespace {

[[noreturn]] void stop() {
    for (;;) {}
}

using Handler = void (*)();
struct Vectors {
    uint32_t* stack;
    Handler handlers[15];
};
[[gnu::section(".vectors"), gnu::used]] const Vectors vectors = {
    stack_top, {start, stop, stop, stop, stop, stop, stop, stop, stop, stop, stop, stop, stop, stop, stop}};

}  // namespace
