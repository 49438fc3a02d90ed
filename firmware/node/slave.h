// SPDX-License-Identifier: Apache-2.0
// The node on one line: it hears every packet, obeys those that mean it, and speaks when it is its turn.
//
// In a sync or bulk read each device waits for the status of the one before it. One that says nothing costs the time
// that its answer may take: the return delay, the bytes with all the stuffing that they may need, and a margin; as long
// as bytes come, somebody still speaks. In a fast read all devices make one packet, and each puts its part behind the
// last byte of the one before; where that is missing there is nothing to go on with, and the node keeps silent.
// To a ping of all it answers after as many slots as there are ids below its own. An instruction that comes while an
// answer waits takes its place: the master has gone on.
#pragma once

#include "node.h"
#include "parser.h"
#include "port.h"

#include <array>
#include <cstddef>
#include <cstdint>

namespace sinew {

class Slave {
public:
    Slave(Node& node, Clock& clock, Wire& wire, Board& board);

    // Hears what has come and does what is due: to be called as often as can be.
    void poll();
    // Whether an answer waits or is being waited for; else there is time for other work.
    bool is_busy() const { return turn_ != Turn::kNone; }
    // When `poll` has something to do although nothing comes, in microseconds from a time; UINT32_MAX: never.
    uint32_t due_in(uint32_t now_us) const;

private:
    enum class Turn : uint8_t { kNone, kAnswer, kOthers, kFastOthers };
    enum class Answer : uint8_t { kPing, kStatus, kRead, kFastPart };

    struct Span {
        uint16_t address, size;
    };

    void hear(uint8_t byte);
    void tick();
    void obey();
    void obey_alone();
    Error obey_write(bool at_once);
    void join_read(bool is_bulk, bool is_fast);
    void obey_group_write(bool is_bulk);
    void await_others(bool is_fast);
    void hear_status();
    void hear_fast_byte();
    void give_up_waiting();

    void plan(Answer answer, uint32_t delay_us);
    void reply(Error error);
    void speak();
    void speak_fast_part();
    void send_status(Error error, const uint8_t* params, size_t count);
    void settle();

    uint8_t error_byte(Error error) const { return static_cast<uint8_t>(error | (node_.alert() ? 0x80 : 0)); }
    uint32_t wire_us(size_t bytes) const;
    uint32_t slot_us(size_t bytes) const;

    Node& node_;
    Clock& clock_;
    Wire& wire_;
    Board& board_;
    Parser parser_;
    uint32_t baud_;

    Turn turn_ = Turn::kNone;
    uint32_t due_us_ = 0;
    // The answer that waits.
    Answer answer_ = Answer::kStatus;
    uint8_t sender_ = 0;
    Error error_ = kNone;
    Span span_{};
    bool restarts_ = false;
    bool avoids_others_ = false;
    // The devices before the node in a read of several, and how many of them have had their turn.
    std::array<uint8_t, kHighestId + 1> before_{};
    std::array<uint16_t, kHighestId + 1> before_size_{};
    size_t before_count_ = 0, before_done_ = 0;
    // Of a fast read: bytes of the packet before the node's part, and LEN of the whole.
    size_t fast_start_ = 0;
    uint16_t fast_length_ = 0;
    uint16_t fast_crc_ = 0;

    std::array<uint8_t, kLongest + 16> out_{};
};

}  // namespace sinew
