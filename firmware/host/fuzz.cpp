// SPDX-License-Identifier: Apache-2.0
// Streams of bytes that a line could carry on a bad day, from a seed, against the node: to be run under sanitizers.
//
//   imu-node-fuzz STREAMS SEED
//
// A stream is a few packets, whole, damaged, cut off or behind garbage, for the node, for others or for all, and what
// others answer; times pass between. When the line has then been quiet for 20 ms, the node must answer a ping. Prints what was sent and heard as JSON.
#include "../node/imu_chip.h"
#include "../node/crc.h"
#include "../node/node.h"
#include "../node/parser.h"
#include "../node/slave.h"
#include "board.h"
#include "still_chip.h"

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <vector>

namespace {

using namespace sinew;
using Bytes = std::vector<uint8_t>;

class Chance {
public:
    explicit Chance(uint64_t seed) : state_(seed * 0x9E3779B97F4A7C15ull + 1) {}
    uint32_t below(uint32_t limit) {
        state_ ^= state_ << 13;
        state_ ^= state_ >> 7;
        state_ ^= state_ << 17;
        return static_cast<uint32_t>((state_ >> 16) % limit);
    }
    uint8_t byte() { return static_cast<uint8_t>(below(256)); }
    template <size_t N>
    uint8_t of(const uint8_t (&these)[N]) {
        return these[below(N)];
    }

private:
    uint64_t state_;
};

class Board final : public Clock, public Inbox, public Memory, public sinew::Board {
public:
    uint32_t now_us = 0;
    Bytes said;
    bool restarts = false;
    uint64_t bytes_said = 0;

    uint32_t micros() override { return now_us; }
    void write(const uint8_t* bytes, size_t size) override {
        said.insert(said.end(), bytes, bytes + size);
        bytes_said += size;
        now_us += static_cast<uint32_t>(size * 10);
    }
    void set_baud(uint32_t) override {}
    void restart() override { restarts = true; }
    void wait_ms(uint32_t) override {}
};

void add_crc(Bytes& frame) {
    const uint16_t crc = crc16(frame.data(), frame.size());
    frame.push_back(static_cast<uint8_t>(crc));
    frame.push_back(static_cast<uint8_t>(crc >> 8));
}

Bytes packet(uint8_t id, uint8_t code, const Bytes& params, bool stuffs = true) {
    Bytes body{code};
    uint32_t pattern = code;
    for (const uint8_t byte : params) {
        body.push_back(byte);
        pattern = (pattern << 8 | byte) & 0xFFFFFF;
        if (pattern == 0xFFFFFD && stuffs) body.push_back(0xFD);
    }
    const size_t length = body.size() + 2;
    Bytes frame{0xFF, 0xFF, 0xFD, 0x00, id, static_cast<uint8_t>(length), static_cast<uint8_t>(length >> 8)};
    frame.insert(frame.end(), body.begin(), body.end());
    add_crc(frame);
    return frame;
}

constexpr int32_t kPatienceUs = 20000;  // of a master that hears nothing; at 9600 baud a device may begin after 8 ms
constexpr uint32_t kMostUs = 500;
constexpr uint8_t kPlaces[] = {7, 50, 68, 100};
constexpr uint8_t kPieces[] = {0xFF, 0xFF, 0xFF, 0xFD, 0xFD, 0x00, 0x55, 0xFE, 0xC8, 0x01};
constexpr uint8_t kCodes[] = {kPing,     kRead,      kRead,      kWrite,        kWrite,    kRegWrite,  kAction,       kFactoryReset,
                              kReboot,   kSyncRead,  kSyncWrite, kFastSyncRead, kBulkRead, kBulkWrite, kFastBulkRead, 0x10,
                              kSyncRead, kBulkRead,  0x00,       0xEE};

class Fuzz {
public:
    explicit Fuzz(uint64_t seed) : chance_(seed) { start(); }

    void run_stream() {
        const uint32_t packets = 1 + chance_.below(4);
        for (uint32_t at = 0; at < packets; ++at) send(arriving());
        if (chance_.below(4) == 0) pass(static_cast<int32_t>(chance_.below(3000)));
        ++streams_;
        if (answers_ping()) return;
        // A packet that lost just its last byte FF takes the first of the ping's header for it: nobody can tell.
        ++shared_;
        if (!lacks_ff_ || !answers_ping()) fail("does not answer a ping");
    }

    void report() const {
        std::printf("{\"streams\": %" PRIu64 ", \"packets\": %" PRIu64 ", \"damaged\": %" PRIu64 ", \"bytes\": %" PRIu64
                    ", \"bytes_said\": %" PRIu64 ", \"restarts\": %" PRIu64 ", \"shared\": %" PRIu64
                    ", \"failures\": 0}\n",
                    streams_, packets_, damaged_, bytes_, board_.bytes_said, restarts_, shared_);
    }

private:
    void start() {
        slave_.reset();
        chip_.reset();
        node_ = std::make_unique<Node>(board_, board_);
        chip_ = std::make_unique<Chip>(*node_, board_, still_, board_);
        chip_->begin();
        slave_ = std::make_unique<Slave>(*node_, board_, board_, board_);
    }

    uint8_t some_id() {
        const uint8_t ids[] = {node_->id(), node_->id(), node_->id(), kBroadcast, 1, 2, 252, chance_.byte()};
        return chance_.of(ids);
    }

    Bytes some_bytes(uint32_t most) {
        Bytes bytes(chance_.below(most + 1));
        const bool is_random = chance_.below(2) == 0;
        for (auto& byte : bytes) byte = is_random ? chance_.byte() : chance_.of(kPieces);
        return bytes;
    }

    void add_span(Bytes& params) {
        const uint32_t address = chance_.below(8) == 0 ? chance_.below(65536) : chance_.below(page::kSize + 4);
        const uint32_t size = chance_.below(16) == 0 ? chance_.below(65536) : chance_.below(page::kSize);
        for (const uint32_t word : {address, size}) {
            params.push_back(static_cast<uint8_t>(word));
            params.push_back(static_cast<uint8_t>(word >> 8));
        }
    }

    Bytes instruction() {
        const uint8_t code = chance_.of(kCodes);
        const bool is_group = code >= 0x80 && code != 0xEE;
        const uint8_t id = is_group ? kBroadcast : some_id();
        Bytes params;
        if (chance_.below(8) == 0) {
            params = some_bytes(40);
        } else if (code == kRead) {
            add_span(params);
        } else if (code == kWrite || code == kRegWrite) {
            const uint8_t places[] = {7, 8, 9, 50, 68, 32, 75, chance_.byte()};
            params = {chance_.of(places), 0};
            const Bytes data = some_bytes(5);
            params.insert(params.end(), data.begin(), data.end());
        } else if (code == kFactoryReset) {
            params = {static_cast<uint8_t>(chance_.below(4))};
        } else if (code == kSyncRead || code == kFastSyncRead) {
            add_span(params);
            for (uint32_t count = chance_.below(6); count > 0; --count) params.push_back(some_id());
        } else if (code == kBulkRead || code == kFastBulkRead) {
            for (uint32_t count = chance_.below(6); count > 0; --count) {
                params.push_back(some_id());
                add_span(params);
            }
        } else if (code == kSyncWrite) {
            const uint8_t size = static_cast<uint8_t>(chance_.below(4));
            params = {chance_.of(kPlaces), 0, size, 0};
            for (uint32_t count = chance_.below(5); count > 0; --count) {
                params.push_back(some_id());
                for (uint8_t at = 0; at < size; ++at) params.push_back(chance_.of(kPieces));
            }
        } else if (code == kBulkWrite) {
            for (uint32_t count = chance_.below(5); count > 0; --count) {
                const uint8_t size = static_cast<uint8_t>(chance_.below(4));
                params.insert(params.end(), {some_id(), chance_.of(kPlaces), 0, size, 0});
                for (uint8_t at = 0; at < size; ++at) params.push_back(chance_.of(kPieces));
            }
        }
        return packet(id, code, params, chance_.below(32) != 0);
    }

    Bytes arriving() {
        ++packets_;
        lacks_ff_ = false;
        Bytes wire = instruction();
        const uint32_t kind = chance_.below(10);
        if (kind == 0) {  // what another answers
            Bytes params = some_bytes(30);
            params.insert(params.begin(), 0);
            return packet(static_cast<uint8_t>(chance_.below(4)), kStatus, params);
        }
        if (kind == 1) {  // what others answer to a fast read
            Bytes body{0xFF, 0xFF, 0xFD, 0x00, kBroadcast, chance_.byte(), static_cast<uint8_t>(chance_.below(2)), kStatus};
            const Bytes data = some_bytes(40);
            body.insert(body.end(), data.begin(), data.end());
            add_crc(body);
            return body;
        }
        if (kind == 2) return some_bytes(60);
        if (kind > 5) return wire;
        ++damaged_;
        const size_t at = chance_.below(static_cast<uint32_t>(wire.size()));
        if (kind == 3) {
            lacks_ff_ = at + 1 == wire.size() && wire.back() == 0xFF;
            wire.resize(at);
        }
        if (kind == 4) wire[at] = static_cast<uint8_t>(wire[at] ^ 1u << chance_.below(8));
        if (kind == 5) wire.insert(wire.begin() + static_cast<std::ptrdiff_t>(at), chance_.of(kPieces));
        return wire;
    }

    void send(const Bytes& wire) {
        for (const uint8_t byte : wire) {
            board_.now_us += 10;
            ++bytes_;
            board_.inbox.push_back(byte);
            poll();
        }
        if (chance_.below(2) == 0) pass(static_cast<int32_t>(chance_.below(600)));
    }

    void pass(int32_t microseconds) {
        const uint32_t until = board_.now_us + static_cast<uint32_t>(microseconds);
        for (int32_t left = microseconds; left > 0; left = static_cast<int32_t>(until - board_.now_us)) {
            const uint32_t step = std::min({slave_->due_in(board_.now_us), static_cast<uint32_t>(left), kMostUs});
            board_.now_us += std::max(step, 1u);
            poll();
        }
    }

    void poll() {
        slave_->poll();
        if (!slave_->is_busy()) chip_->poll();
        if (!board_.restarts) return;
        board_.restarts = false;
        board_.inbox.clear();
        ++restarts_;
        start();
    }

    bool answers_ping() {
        board_.said.clear();
        pass(kPatienceUs);
        const uint8_t id = node_->id();
        send(packet(id, kPing, {}));
        pass(3000);
        // What it still said before is followed by the answer.
        Parser parser;
        bool found = false;
        for (const uint8_t byte : board_.said)
            if (parser.feed(byte) == Heard::kStatus && parser.id() == id && parser.param_count() == 4) found = true;
        return found && node_->id() <= kHighestId;
    }

    [[noreturn]] void fail(const char* what) {
        std::fprintf(stderr, "stream %" PRIu64 ": the node %s (id %u, baud %u, now %u, said", streams_, what, node_->id(),
                     node_->baud(), board_.now_us);
        for (const uint8_t byte : board_.said) std::fprintf(stderr, " %02x", byte);
        std::fprintf(stderr, ")\n");
        std::exit(1);
    }

    Chance chance_;
    Board board_;
    StillChip still_{board_, kMpu9250};
    std::unique_ptr<Node> node_;
    std::unique_ptr<Chip> chip_;
    std::unique_ptr<Slave> slave_;
    uint64_t streams_ = 0, packets_ = 0, damaged_ = 0, bytes_ = 0, restarts_ = 0, shared_ = 0;
    bool lacks_ff_ = false;
};

}  // namespace

int main(int count, char** words) {
    if (count != 3) {
        std::fprintf(stderr, "imu-node-fuzz: found %d words; expected how many streams, and a seed\n", count - 1);
        return 2;
    }
    Fuzz fuzz(std::strtoull(words[2], nullptr, 10));
    const uint64_t streams = std::strtoull(words[1], nullptr, 10);
    for (uint64_t at = 0; at < streams; ++at) fuzz.run_stream();
    fuzz.report();
    return 0;
}
