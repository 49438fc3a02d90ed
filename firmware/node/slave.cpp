// SPDX-License-Identifier: Apache-2.0
#include "slave.h"

#include "crc.h"
#include "frame.h"

#include <algorithm>
#include <bitset>
#include <cstring>

namespace sinew {
namespace {

constexpr uint32_t kBitsPerByte = 10;
constexpr uint32_t kMarginUs = 100;  // what a device may be late by
constexpr size_t kStatusBytes = 11;  // of a status without parameters
constexpr size_t kPingBytes = 14;
constexpr size_t kFastHead = 8;
constexpr size_t kFastAround = 4;  // ERR, ID and CRC around a device's data

uint16_t word(const uint8_t* bytes) { return static_cast<uint16_t>(bytes[0] | bytes[1] << 8); }

size_t most_stuffed(size_t size) { return size + size / 3 + 1; }

// Whether ids, `step` bytes apart, are of devices and each there once.
bool are_devices(const uint8_t* ids, size_t count, size_t step) {
    std::bitset<kHighestId + 1> seen;
    for (size_t at = 0; at < count; ++at) {
        const uint8_t id = ids[at * step];
        if (id > kHighestId || seen[id]) return false;
        seen[id] = true;
    }
    return count > 0;
}

}  // namespace

Slave::Slave(Node& node, Clock& clock, Wire& wire, Board& board)
    : node_(node), clock_(clock), wire_(wire), board_(board), baud_(node.baud()) {
    wire_.set_baud(baud_);
}

void Slave::poll() {
    for (int byte = wire_.read(); byte >= 0; byte = wire_.read()) {
        tick();
        hear(static_cast<uint8_t>(byte));
    }
    tick();
}

uint32_t Slave::due_in(uint32_t now_us) const {
    if (turn_ == Turn::kNone) return UINT32_MAX;
    const auto left = static_cast<int32_t>(due_us_ - now_us);
    return left > 0 ? static_cast<uint32_t>(left) : 0;
}

void Slave::hear(uint8_t byte) {
    const Heard heard = parser_.feed(byte);
    if (heard == Heard::kInstruction) {
        parser_.follow_fast(false);
        const bool is_due = turn_ == Turn::kAnswer, restarts = is_due && restarts_;
        turn_ = Turn::kNone;
        if (is_due) settle();  // what was obeyed stays obeyed, though nobody waits for its answer any more
        if (!restarts) obey();
    } else if (turn_ == Turn::kFastOthers) {
        hear_fast_byte();
    } else if (turn_ == Turn::kOthers) {
        // Somebody speaks: nobody else does until there was time for two bytes more.
        const uint32_t later = clock_.micros() + wire_us(2) + kMarginUs;
        if (static_cast<int32_t>(later - due_us_) > 0) due_us_ = later;
        if (heard == Heard::kStatus) hear_status();
    } else if (turn_ == Turn::kAnswer && avoids_others_) {
        const uint32_t later = clock_.micros() + wire_us(2) + kMarginUs;
        if (static_cast<int32_t>(later - due_us_) > 0) due_us_ = later;
    }
    // An answer that is due at once is said before the next byte is heard.
    tick();
}

void Slave::tick() {
    if (turn_ == Turn::kNone || static_cast<int32_t>(clock_.micros() - due_us_) < 0) return;
    if (turn_ == Turn::kAnswer) {
        turn_ = Turn::kNone;
        speak();
        settle();
    } else {
        give_up_waiting();
    }
}

// Instructions.

void Slave::obey() {
    const uint8_t code = parser_.code();
    if (code == kSyncRead || code == kFastSyncRead) return join_read(false, code == kFastSyncRead);
    if (code == kBulkRead || code == kFastBulkRead) return join_read(true, code == kFastBulkRead);
    if (code == kSyncWrite || code == kBulkWrite) {
        obey_group_write(code == kBulkWrite);
        return settle();
    }
    if (parser_.id() == node_.id() || parser_.id() == kBroadcast) obey_alone();
}

void Slave::obey_alone() {
    const bool to_all = parser_.id() == kBroadcast;
    const uint8_t level = node_.status_return_level();
    sender_ = node_.id();
    restarts_ = false;
    avoids_others_ = false;
    Error error = kInstruction;
    switch (parser_.code()) {
        case kPing:
            avoids_others_ = to_all;
            return plan(Answer::kPing, node_.return_delay_us() + (to_all ? node_.id() * slot_us(kPingBytes) : 0));
        case kRead:
            if (to_all || level < 1) return;
            if (parser_.param_count() != 4) return reply(kDataLength);
            span_ = {word(parser_.params()), word(parser_.params() + 2)};
            return plan(Answer::kRead, node_.return_delay_us());
        case kWrite: error = obey_write(true); break;
        case kRegWrite: error = obey_write(false); break;
        case kAction: error = node_.act(); break;
        case kReboot:
            error = kNone;
            restarts_ = true;
            break;
        case kFactoryReset: {
            const uint8_t keep = parser_.param_count() == 1 ? parser_.params()[0] : 0;
            const bool is_known = keep == 1 || keep == 2 || (keep == 0xFF && !to_all);
            error = is_known ? kNone : kDataRange;
            if (is_known) node_.reset(keep == 1 || keep == 2, keep == 2);
            restarts_ = is_known;
            break;
        }
        default: break;
    }
    // The answer to what changes whether and how is answered still goes by the old settings.
    if (!to_all && level >= 2) return reply(error);
    settle();
}

Error Slave::obey_write(bool at_once) {
    const size_t count = parser_.param_count();
    if (count < 3) return kDataLength;
    const uint16_t address = word(parser_.params());
    const uint8_t* data = parser_.params() + 2;
    return at_once ? node_.write(address, data, count - 2) : node_.prepare(address, data, count - 2);
}

void Slave::obey_group_write(bool is_bulk) {
    const uint8_t* params = parser_.params();
    const size_t count = parser_.param_count();
    restarts_ = false;
    if (!is_bulk) {
        if (count <= 4) return;
        const uint16_t address = word(params);
        const size_t size = word(params + 2), each = 1 + size;
        if (size == 0 || (count - 4) % each != 0 || !are_devices(params + 4, (count - 4) / each, each)) return;
        for (const uint8_t* at = params + 4; at < params + count; at += each)
            if (*at == node_.id()) return static_cast<void>(node_.write(address, at + 1, size));
        return;
    }
    std::bitset<kHighestId + 1> seen;
    const uint8_t* own = nullptr;
    size_t at = 0;
    while (at < count) {
        if (count - at < 5) return;
        const uint8_t id = params[at];
        const size_t size = word(params + at + 3);
        if (id > kHighestId || seen[id] || size == 0 || count - at - 5 < size) return;
        seen[id] = true;
        if (id == node_.id()) own = params + at;
        at += 5 + size;
    }
    if (own != nullptr) node_.write(word(own + 1), own + 5, word(own + 3));
}

// Reads of several devices.

void Slave::join_read(bool is_bulk, bool is_fast) {
    const uint8_t* params = parser_.params();
    const size_t count = parser_.param_count(), step = is_bulk ? 5 : 1, head = is_bulk ? 0 : 4;
    if (count <= head || (count - head) % step != 0) return;
    const uint8_t* devices = params + head;
    const size_t device_count = (count - head) / step;
    if (!are_devices(devices, device_count, step)) return;

    size_t place = device_count, fast_length = 1;
    fast_start_ = kFastHead;
    for (size_t at = 0; at < device_count; ++at) {
        const uint8_t* device = devices + at * step;
        const Span span = is_bulk ? Span{word(device + 1), word(device + 3)} : Span{word(params), word(params + 2)};
        fast_length += span.size + kFastAround;
        if (*device == node_.id()) {
            place = at;
            span_ = span;
        }
        if (place == device_count) {
            before_[at] = *device;
            before_size_[at] = span.size;
            fast_start_ += span.size + kFastAround;
        }
    }
    if (place == device_count || node_.status_return_level() < 1) return;
    if (is_fast && fast_length > kLongest) return;

    sender_ = node_.id();
    restarts_ = false;
    avoids_others_ = false;
    fast_length_ = static_cast<uint16_t>(fast_length);
    before_count_ = place;
    before_done_ = 0;
    if (place > 0) return await_others(is_fast);
    plan(is_fast ? Answer::kFastPart : Answer::kRead, node_.return_delay_us());
}

void Slave::await_others(bool is_fast) {
    turn_ = is_fast ? Turn::kFastOthers : Turn::kOthers;
    parser_.follow_fast(is_fast);
    const size_t bytes = is_fast ? kFastHead : kStatusBytes + most_stuffed(before_size_[before_done_]);
    due_us_ = clock_.micros() + slot_us(bytes);
}

void Slave::hear_status() {
    for (size_t at = before_done_; at < before_count_; ++at) {
        if (before_[at] != parser_.id()) continue;
        before_done_ = at + 1;
        if (before_done_ < before_count_) return await_others(false);
        return plan(Answer::kRead, node_.return_delay_us());
    }
}

void Slave::hear_fast_byte() {
    const size_t bytes = parser_.fast_bytes();
    if (bytes < kFastHead || parser_.length() != fast_length_) return;
    due_us_ = clock_.micros() + slot_us(2);
    if (bytes < fast_start_) return;
    if (bytes == fast_start_ && parser_.ends_with_crc()) {
        fast_crc_ = parser_.crc();
        parser_.reset();
        return plan(Answer::kFastPart, 0);
    }
    parser_.reset();
    turn_ = Turn::kNone;
}

void Slave::give_up_waiting() {
    if (turn_ == Turn::kFastOthers) {
        parser_.reset();
        turn_ = Turn::kNone;
        return;
    }
    if (++before_done_ < before_count_) return await_others(false);
    plan(Answer::kRead, 0);
}

// Answers.

void Slave::plan(Answer answer, uint32_t delay_us) {
    turn_ = Turn::kAnswer;
    answer_ = answer;
    due_us_ = clock_.micros() + delay_us;
}

void Slave::reply(Error error) {
    error_ = error;
    plan(Answer::kStatus, node_.return_delay_us());
}

void Slave::speak() {
    if (answer_ == Answer::kFastPart) return speak_fast_part();
    if (answer_ == Answer::kStatus) return send_status(error_, nullptr, 0);
    if (answer_ == Answer::kPing) {
        const uint8_t who[] = {static_cast<uint8_t>(page::kModel), static_cast<uint8_t>(page::kModel >> 8), kFirmware};
        return send_status(kNone, who, sizeof who);
    }
    const uint8_t* data = node_.read(span_.address, span_.size);
    send_status(data ? kNone : kAccess, data, data ? span_.size : 0);
}

void Slave::send_status(Error error, const uint8_t* params, size_t count) {
    Frame frame(out_.data(), sender_);
    frame.add(error_byte(error));
    for (size_t at = 0; at < count; ++at) frame.add(params[at]);
    wire_.write(out_.data(), frame.finish());
}

void Slave::speak_fast_part() {
    size_t size = 0;
    if (before_count_ == 0) {
        const uint8_t head[] = {0xFF, 0xFF, 0xFD, 0x00, kBroadcast, static_cast<uint8_t>(fast_length_),
                                static_cast<uint8_t>(fast_length_ >> 8), kStatus};
        std::memcpy(out_.data(), head, sizeof head);
        size = sizeof head;
        fast_crc_ = 0;
    }
    const uint8_t* data = node_.read(span_.address, span_.size);
    out_[size++] = error_byte(data ? kNone : kAccess);
    out_[size++] = sender_;
    if (data != nullptr)
        std::memcpy(out_.data() + size, data, span_.size);
    else
        std::memset(out_.data() + size, 0, span_.size);
    size += span_.size;
    const uint16_t crc = crc16(out_.data(), size, fast_crc_);
    out_[size++] = static_cast<uint8_t>(crc);
    out_[size++] = static_cast<uint8_t>(crc >> 8);
    wire_.write(out_.data(), size);
}

void Slave::settle() {
    node_.settle();
    if (restarts_) {
        restarts_ = false;
        parser_.reset();
        board_.restart();
        node_.start();
    }
    if (node_.baud() != baud_) {
        baud_ = node_.baud();
        wire_.set_baud(baud_);
    }
}

uint32_t Slave::wire_us(size_t bytes) const {
    return static_cast<uint32_t>(static_cast<uint64_t>(bytes) * kBitsPerByte * 1000000 / baud_) + 1;
}

uint32_t Slave::slot_us(size_t bytes) const { return node_.return_delay_us() + wire_us(bytes) + kMarginUs; }

}  // namespace sinew
