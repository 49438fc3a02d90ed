// SPDX-License-Identifier: Apache-2.0
// Six devices on a pseudo-terminal that think for microseconds, as real ones do: registers in memory, each byte's time on
// the wire, motors that are where they are told to be, springs for tendons, a sensor that lies still. `benchmarks bus`
// measures the driver with it where the emulator's own thinking would be what is measured.
//
// From the standard input, a line each: `baud N`; `device ID HEX` (its registers), then of that device `tick ADDRESS`
// (milliseconds, 15 bits), `clock ADDRESS` (microseconds), `follows GOAL PRESENT` (addresses of angles), `pulls CURRENT
// LIMIT SLACK RATE` (a current of RATE counts for each count of the angle beyond SLACK, as far as the one at LIMIT lets
// it; SLACK and RATE have the sign of the pull), `samples TIME COUNT PERIOD_US`; at last `run`. It prints the
// pseudo-terminal's name, and ends with its input.
#include "../firmware/node/crc.h"
#include "../firmware/node/frame.h"
#include "../firmware/node/parser.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <fcntl.h>
#include <iostream>
#include <poll.h>
#include <sched.h>
#include <sstream>
#include <string>
#include <termios.h>
#include <unistd.h>
#include <vector>

namespace {

using namespace sinew;

constexpr uint64_t kBits = 10;
constexpr int kNowhere = -1;

uint64_t now_ns() {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return static_cast<uint64_t>(now.tv_sec) * 1'000'000'000u + static_cast<uint64_t>(now.tv_nsec);
}

void sleep_until(uint64_t ns) {
    const timespec until{static_cast<time_t>(ns / 1'000'000'000u), static_cast<long>(ns % 1'000'000'000u)};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
}

uint16_t word(const uint8_t* bytes) { return static_cast<uint16_t>(bytes[0] | bytes[1] << 8); }

struct Device {
    uint8_t id = 0;
    std::vector<uint8_t> bytes;
    int tick = kNowhere, clock = kNowhere, goal = kNowhere, present = kNowhere, current = kNowhere, limit = kNowhere;
    int sample_time = kNowhere, samples = kNowhere;
    uint32_t period_us = 0;
    double slack = 0, rate = 0;

    void store(int address, uint64_t count, size_t size) {
        for (size_t at = 0; at < size; ++at)
            bytes[static_cast<size_t>(address) + at] = static_cast<uint8_t>(count >> (8 * at));
    }
    int32_t count(int address, size_t size) const {
        uint32_t found = 0;
        for (size_t at = 0; at < size; ++at) found |= static_cast<uint32_t>(bytes[static_cast<size_t>(address) + at]) << (8 * at);
        return size == 2 ? static_cast<int16_t>(found) : static_cast<int32_t>(found);
    }
    void move() {
        double angle = count(goal, 4);
        if (current >= 0) {
            const double most = count(limit, 2), wanted = std::abs(rate) * (rate > 0 ? angle - slack : slack - angle);
            const double pulled = std::clamp(wanted, 0.0, most);
            if (wanted > most) angle = slack + most / rate;
            store(current, static_cast<uint64_t>(std::lround(rate > 0 ? pulled : -pulled)), 2);
        }
        store(present, static_cast<uint64_t>(std::lround(angle)), 4);
    }
    // Puts the registers that live to what they are at a time; nullptr where there are none.
    const uint8_t* read(uint16_t address, uint16_t size, uint64_t ns) {
        if (size == 0 || static_cast<size_t>(address) + size > bytes.size()) return nullptr;
        const uint64_t us = ns / 1000;
        if (tick >= 0) store(tick, us / 1000 & 0x7FFF, 2);
        if (clock >= 0) store(clock, us, 4);
        if (goal >= 0) move();
        if (samples >= 0) {
            store(samples, us / period_us, 4);
            store(sample_time, us / period_us * period_us, 4);
        }
        return &bytes[address];
    }
    bool write(uint16_t address, const uint8_t* data, size_t size) {
        if (address + size > bytes.size()) return false;
        std::copy(data, data + size, bytes.begin() + address);
        return true;
    }
};

class Bus {
public:
    Bus(std::vector<Device> devices, uint32_t baud, int descriptor)
        : devices_(std::move(devices)), byte_ns_(kBits * 1'000'000'000u / baud), descriptor_(descriptor) {}

    void hear(uint8_t byte) {
        ++heard_;
        if (parser_.feed(byte) != Heard::kInstruction) return;
        free_ns_ = std::max(now_ns(), free_ns_) + heard_ * byte_ns_;
        heard_ = 0;
        obey();
    }

private:
    Device* find(uint8_t id) {
        for (Device& device : devices_)
            if (device.id == id) return &device;
        return nullptr;
    }
    // Says bytes that take their time on the wire, behind what was said before.
    void say(const uint8_t* bytes, size_t size) {
        free_ns_ += size * byte_ns_;
        sleep_until(free_ns_);
        if (::write(descriptor_, bytes, size) < 0) std::perror("bus-player: write");
    }
    void answer(uint8_t id, Error error, const uint8_t* data, size_t size) {
        Frame frame(out_, id);
        frame.add(error);
        for (size_t at = 0; at < size; ++at) frame.add(data[at]);
        say(out_, frame.finish());
    }
    void answer_read(Device& device, uint16_t address, uint16_t size) {
        const uint8_t* data = device.read(address, size, free_ns_);
        answer(device.id, data ? kNone : kAccess, data, data ? size : 0);
    }
    void answer_ping(const Device& device) {
        const uint8_t who[] = {device.bytes[0], device.bytes[1], device.bytes[6]};
        answer(device.id, kNone, who, sizeof who);
    }

    void obey() {
        const uint8_t* params = parser_.params();
        const size_t count = parser_.param_count();
        const bool to_all = parser_.id() == kBroadcast;
        switch (parser_.code()) {
            case kSyncRead: case kFastSyncRead: case kBulkRead: case kFastBulkRead: return read_many(params, count);
            case kSyncWrite:
                for (size_t at = 4, each = 1u + word(params + 2); at + each <= count; at += each)
                    if (Device* device = find(params[at])) device->write(word(params), params + at + 1, each - 1);
                return;
            case kBulkWrite:
                for (size_t at = 0; at + 5 <= count; at += 5u + word(params + at + 3))
                    if (Device* device = find(params[at]))
                        device->write(word(params + at + 1), params + at + 5, word(params + at + 3));
                return;
            case kPing:
                for (const Device& device : devices_)
                    if (to_all || device.id == parser_.id()) answer_ping(device);
                return;
            default: break;
        }
        Device* device = find(parser_.id());
        if (device == nullptr) return;
        if (parser_.code() == kRead && count == 4) return answer_read(*device, word(params), word(params + 2));
        if (parser_.code() == kWrite && count > 2) {
            const bool fits = device->write(word(params), params + 2, count - 2);
            return answer(device->id, fits ? kNone : kAccess, nullptr, 0);
        }
        answer(device->id, kInstruction, nullptr, 0);
    }

    void read_many(const uint8_t* params, size_t count) {
        const uint8_t code = parser_.code();
        const bool is_bulk = code == kBulkRead || code == kFastBulkRead, is_fast = code == kFastSyncRead || code == kFastBulkRead;
        size_t fast = 8;
        for (size_t at = is_bulk ? 0 : 4; at < count; at += is_bulk ? 5 : 1) {
            Device* device = find(params[at]);
            const uint8_t* span = is_bulk ? params + at + 1 : params;
            const uint16_t address = word(span), size = word(span + 2);
            if (device == nullptr) {
                if (is_fast) return;
                continue;
            }
            if (!is_fast) {
                answer_read(*device, address, size);
                continue;
            }
            const uint8_t* data = device->read(address, size, free_ns_ + fast * byte_ns_);
            out_[fast++] = data ? kNone : kAccess;
            out_[fast++] = device->id;
            if (data != nullptr) std::memcpy(out_ + fast, data, size);
            fast += size + 2u;  // its CRC is put in below, when LEN is known
            ends_.push_back(fast);
        }
        if (!is_fast) return;
        const size_t length = fast - 7;
        const uint8_t head[] = {0xFF, 0xFF, 0xFD, 0x00, kBroadcast, static_cast<uint8_t>(length),
                                static_cast<uint8_t>(length >> 8), kStatus};
        std::memcpy(out_, head, sizeof head);
        for (const size_t end : ends_) {
            const uint16_t crc = crc16(out_, end - 2);
            out_[end - 2] = static_cast<uint8_t>(crc);
            out_[end - 1] = static_cast<uint8_t>(crc >> 8);
        }
        ends_.clear();
        say(out_, fast);
    }

    std::vector<Device> devices_;
    uint64_t byte_ns_;
    int descriptor_;
    Parser parser_;
    uint64_t heard_ = 0, free_ns_ = 0;
    std::vector<size_t> ends_;
    uint8_t out_[2 * kLongest] = {};
};

int open_terminal() {
    const int descriptor = posix_openpt(O_RDWR | O_NOCTTY);
    if (descriptor < 0 || grantpt(descriptor) != 0 || unlockpt(descriptor) != 0) {
        std::perror("bus-player: no pseudo-terminal to be had");
        return -1;
    }
    const int held = open(ptsname(descriptor), O_RDWR | O_NOCTTY);  // so that it does not hang up when a master leaves
    termios raw{};
    if (tcgetattr(held, &raw) == 0) {
        cfmakeraw(&raw);
        tcsetattr(held, TCSANOW, &raw);
    }
    return descriptor;
}

std::vector<uint8_t> bytes_of(const std::string& hex) {
    std::vector<uint8_t> bytes;
    for (size_t at = 0; at + 1 < hex.size(); at += 2)
        bytes.push_back(static_cast<uint8_t>(std::stoul(hex.substr(at, 2), nullptr, 16)));
    return bytes;
}

}  // namespace

int main() {
    std::vector<Device> devices;
    uint32_t baud = 0;
    for (std::string line; std::getline(std::cin, line) && line != "run";) {
        std::istringstream words(line);
        std::string what, hex;
        words >> what;
        if (what == "baud") {
            words >> baud;
        } else if (what == "device") {
            unsigned id = 0;
            words >> id >> hex;
            devices.emplace_back();
            devices.back().id = static_cast<uint8_t>(id);
            devices.back().bytes = bytes_of(hex);
        } else if (what == "tick") {
            words >> devices.back().tick;
        } else if (what == "clock") {
            words >> devices.back().clock;
        } else if (what == "follows") {
            words >> devices.back().goal >> devices.back().present;
        } else if (what == "pulls") {
            words >> devices.back().current >> devices.back().limit >> devices.back().slack >> devices.back().rate;
        } else if (what == "samples") {
            words >> devices.back().sample_time >> devices.back().samples >> devices.back().period_us;
        }
    }
    const int descriptor = open_terminal();
    if (descriptor < 0 || baud == 0) return 1;
    const sched_param own{20};
    sched_setscheduler(0, SCHED_FIFO, &own);  // where it may: no motor waits for other programs
    std::printf("%s\n", ptsname(descriptor));
    std::fflush(stdout);
    Bus bus(std::move(devices), baud, descriptor);
    uint8_t heard[4096];
    for (;;) {
        pollfd wanted[] = {{descriptor, POLLIN, 0}, {STDIN_FILENO, POLLIN, 0}};
        ::poll(wanted, 2, -1);
        if (wanted[1].revents != 0) return 0;
        const ssize_t got = ::read(descriptor, heard, sizeof heard);
        for (ssize_t at = 0; at < got; ++at) bus.hear(heard[at]);
    }
}
