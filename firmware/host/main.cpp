// SPDX-License-Identifier: Apache-2.0
// The node on a computer.
//
//   imu-node line [--chip HEX] [--id N]   in virtual time, at the other end of a pipe, for tests
//   imu-node pty [--chip HEX] [--id N]    in real time on a pseudo-terminal, whose name it prints
//
// The pipe. To the node: 'B' time_ns byte_ns count bytes (the first byte has come whole at time_ns + byte_ns), 'A' time_ns
// (let time pass), 'C' six counts (what the chip reads from now on), 'F' 0|1 (the chip is frozen), 'P' (the power goes and
// comes back), 'D' us (the board does nothing else for so long). From the node after each: baud, when it has something
// to do on the line (UINT64_MAX: never), number of bursts, then of each its start, how many and which bytes. Little endian.
#include "../node/imu_chip.h"
#include "../node/node.h"
#include "../node/slave.h"
#include "board.h"
#include "still_chip.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <optional>
#include <poll.h>
#include <string>
#include <termios.h>
#include <unistd.h>
#include <vector>

namespace {

using namespace sinew;

constexpr uint64_t kNever = UINT64_MAX;
constexpr int32_t kRoundUs = 20;  // of a round of the board's loop: an exchange of 2 bytes at some MHz, and a look at two lines
constexpr uint64_t kStartNs = 100'000'000;  // the board is deaf for so long after a start

void set_id(Clock& clock, Memory& memory, int id) {
    if (id < 0) return;
    Node node(clock, memory);
    const auto byte = static_cast<uint8_t>(id);
    node.write(page::kId, &byte, 1);
    node.settle();
}

struct Burst {
    uint64_t start_ns;
    std::vector<uint8_t> bytes;
};

class VirtualBoard final : public Clock, public Inbox, public Board {
public:
    uint64_t now_ns = 0;
    uint32_t baud = 0;
    std::vector<Burst> spoken;
    bool restarts = false;

    uint32_t micros() override { return static_cast<uint32_t>(now_ns / 1000); }
    void write(const uint8_t* bytes, size_t size) override {
        spoken.push_back({now_ns, {bytes, bytes + size}});
        now_ns += size * 10'000'000'000ull / baud;
    }
    void set_baud(uint32_t rate) override { baud = rate; }
    void restart() override { restarts = true; }
    void wait_ms(uint32_t) override {}
};

template <typename T>
T take() {
    T value{};
    if (std::fread(&value, sizeof value, 1, stdin) != 1) std::exit(0);
    return value;
}

template <typename T>
void give(T value) {
    std::fwrite(&value, sizeof value, 1, stdout);
}

// The node and what it stands on; made anew at every start, but for the memory.
template <typename B>
struct Made {
    Made(B& board, Memory& memory, StillChip& still)
        : node(board, memory), chip(node, board, still, board), slave(node, board, board, board) {
        chip.begin();
    }
    void poll() {
        slave.poll();
        if (!slave.is_busy()) chip.poll();
    }
    Node node;
    Chip chip;
    Slave slave;
};

class Line {
public:
    Line(uint8_t who_am_i, int id) : still_(board_, who_am_i) {
        set_id(board_, memory_, id);
        made_.emplace(board_, memory_, still_);
    }

    [[noreturn]] void serve() {
        for (;;) {
            obey(take<char>());
            give(board_.baud);
            give(due_on_line());
            give(static_cast<uint32_t>(board_.spoken.size()));
            for (const Burst& burst : board_.spoken) {
                give(burst.start_ns);
                give(static_cast<uint32_t>(burst.bytes.size()));
                std::fwrite(burst.bytes.data(), 1, burst.bytes.size(), stdout);
            }
            board_.spoken.clear();
            std::fflush(stdout);
        }
    }

private:
    void obey(char what) {
        if (what == 'A') return advance(take<uint64_t>());
        if (what == 'P') return restart();
        if (what == 'F') return static_cast<void>(still_.is_frozen = take<uint8_t>() != 0);
        if (what == 'D') {
            board_.now_ns += take<uint32_t>() * 1000ull;
            return;
        }
        if (what == 'C') {
            for (auto& count : still_.sample.gyro) count = take<int16_t>();
            for (auto& count : still_.sample.acceleration) count = take<int16_t>();
            return;
        }
        const auto start = take<uint64_t>(), byte = take<uint64_t>();
        const auto count = take<uint32_t>();
        for (uint32_t at = 1; at <= count; ++at) {
            const auto value = take<uint8_t>();
            advance(start + at * byte);
            if (board_.now_ns < deaf_until_) continue;
            board_.inbox.push_back(value);
            poll();
        }
    }

    void advance(uint64_t until) {
        for (uint64_t next = due(); next <= until; next = due()) {
            board_.now_ns = std::max(next, board_.now_ns);
            poll();
        }
        board_.now_ns = std::max(board_.now_ns, until);
    }

    uint64_t due_on_line() {
        const uint32_t left = made_->slave.due_in(board_.micros());
        return left == UINT32_MAX ? kNever : board_.now_ns / 1000 * 1000 + left * 1000ull;
    }

    uint64_t due() {
        if (board_.now_ns < deaf_until_) return deaf_until_;
        const uint64_t next = due_on_line();
        // Of the rounds of a board's loop those are played that matter: the last before a sample is ready, and the next.
        const auto until_sample = static_cast<int32_t>(still_.next_us() - board_.micros());
        const int32_t wait_us = until_sample > kRoundUs ? until_sample - kRoundUs : std::max(until_sample, 1);
        return std::min<uint64_t>(next, board_.now_ns / 1000 * 1000 + static_cast<uint64_t>(wait_us) * 1000);
    }

    void poll() {
        made_->poll();
        if (board_.restarts) restart();
    }

    void restart() {
        board_.restarts = false;
        board_.inbox.clear();
        made_.emplace(board_, memory_, still_);
        deaf_until_ = board_.now_ns + kStartNs;
    }

    VirtualBoard board_;
    Memory memory_;
    StillChip still_;
    std::optional<Made<VirtualBoard>> made_;
    uint64_t deaf_until_ = 0;
};

class RealBoard final : public Clock, public Wire, public Board {
public:
    int descriptor = -1;
    bool restarts = false;

    uint32_t micros() override {
        const auto now = std::chrono::steady_clock::now().time_since_epoch();
        return static_cast<uint32_t>(std::chrono::duration_cast<std::chrono::microseconds>(now).count());
    }
    int read() override {
        if (next_ == size_) {
            const ssize_t got = ::read(descriptor, buffer_, sizeof buffer_);
            next_ = 0;
            size_ = got > 0 ? static_cast<size_t>(got) : 0;
        }
        return next_ < size_ ? buffer_[next_++] : -1;
    }
    void write(const uint8_t* bytes, size_t size) override {
        if (::write(descriptor, bytes, size) < 0) std::perror("imu-node: write");
    }
    void set_baud(uint32_t) override {}
    void restart() override { restarts = true; }
    void wait_ms(uint32_t) override {}

private:
    uint8_t buffer_[4096] = {};
    size_t next_ = 0, size_ = 0;
};

int serve_pty(uint8_t who_am_i, int id) {
    RealBoard board;
    board.descriptor = posix_openpt(O_RDWR | O_NOCTTY);
    if (board.descriptor < 0 || grantpt(board.descriptor) != 0 || unlockpt(board.descriptor) != 0) {
        std::perror("imu-node: no pseudo-terminal to be had");
        return 1;
    }
    const char* name = ptsname(board.descriptor);
    const int held = open(name, O_RDWR | O_NOCTTY);  // so that it does not hang up when a master leaves
    termios raw{};
    if (tcgetattr(held, &raw) == 0) {
        cfmakeraw(&raw);
        tcsetattr(held, TCSANOW, &raw);
    }
    fcntl(board.descriptor, F_SETFL, O_NONBLOCK);
    std::printf("%s\n", name);
    std::fflush(stdout);
    Memory memory;
    set_id(board, memory, id);
    for (;;) {
        board.restarts = false;
        StillChip still(board, who_am_i);
        Made<RealBoard> made(board, memory, still);
        while (!board.restarts) {
            pollfd wanted[] = {{board.descriptor, POLLIN, 0}, {STDIN_FILENO, POLLIN, 0}};
            ::poll(wanted, 2, made.slave.is_busy() ? 0 : 1);
            if (wanted[1].revents & (POLLHUP | POLLERR)) return 0;
            made.poll();
        }
    }
}

}  // namespace

int main(int count, char** words) {
    uint8_t who_am_i = kMpu9250;
    int id = -1;
    for (int at = 2; at + 1 < count; at += 2) {
        if (std::strcmp(words[at], "--chip") == 0) who_am_i = static_cast<uint8_t>(std::strtol(words[at + 1], nullptr, 16));
        if (std::strcmp(words[at], "--id") == 0) id = std::atoi(words[at + 1]);
    }
    const std::string mode = count > 1 ? words[1] : "";
    if (mode == "line") Line(who_am_i, id).serve();
    if (mode == "pty") return serve_pty(who_am_i, id);
    std::fprintf(stderr, "imu-node: found %s; expected line or pty\n", mode.empty() ? "nothing" : mode.c_str());
    return 2;
}
