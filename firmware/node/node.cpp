// SPDX-License-Identifier: Apache-2.0
#include "node.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace sinew {
namespace {

using page::Row;

constexpr uint8_t kKept[] = {page::kId, page::kBaudRate, page::kReturnDelayTime};
constexpr uint8_t kKeptMark = 0x51;  // before what is kept; another value where the page is

// The first row that has bytes from an address on, before a stop; nullptr where there is only a gap.
const Row* row_among(size_t address, size_t stop) {
    for (const Row& row : page::kRows)
        if (row.address < stop && address < static_cast<size_t>(row.address + row.size)) return &row;
    return nullptr;
}

const Row* row_at(size_t address) { return row_among(address, address + 1); }

uint32_t little_endian(const uint8_t* bytes, uint8_t size) {
    uint32_t count = 0;
    for (uint8_t at = 0; at < size; ++at) count |= static_cast<uint32_t>(bytes[at]) << (8 * at);
    return count;
}

uint8_t check_of(const uint8_t* bytes, size_t size) {
    uint8_t check = kKeptMark;
    for (size_t at = 0; at < size; ++at) check = static_cast<uint8_t>(check * 31 + bytes[at]);
    return check;
}

int16_t tenth_degrees(float radians) {
    constexpr float kPerRadian = 1800.0f / 3.14159265f;
    return static_cast<int16_t>(std::lround(radians * kPerRadian));
}

}  // namespace

Node::Node(Clock& clock, Store& store) : clock_(clock), store_(store) { start(); }

void Node::start() {
    initialise(0);
    std::array<uint8_t, sizeof kKept + 2> kept{};
    const size_t last = kept.size() - 1;
    if (store_.load(kept.data(), kept.size()) && kept[0] == kKeptMark && kept[last] == check_of(kept.data(), last)) {
        for (size_t at = 0; at < sizeof kKept; ++at) {
            const Row& row = *row_at(kKept[at]);
            const uint32_t value = kept[at + 1];
            if (value >= row.low && value <= row.high) bytes_[row.address] = kept[at + 1];
        }
    }
    is_kept_stale_ = false;
    prepared_size_ = 0;
    has_timed_ = false;
}

void Node::initialise(uint16_t from) {
    std::fill(bytes_.begin() + from, bytes_.end(), uint8_t{0});
    for (const Row& row : page::kRows)
        if (row.address >= from) store(row.address, row.initial, row.size);
    if (from <= page::kFirmwareVersion) bytes_[page::kFirmwareVersion] = kFirmware;
}

const uint8_t* Node::read(uint16_t address, uint16_t size) {
    const size_t stop = static_cast<size_t>(address) + size;
    if (stop > page::kSize) return nullptr;
    if (row_among(address, stop) == nullptr) return nullptr;
    store(page::kClock, clock_.micros(), 4);
    return bytes_.data() + address;
}

Error Node::judge(uint16_t address, const uint8_t* data, size_t size) const {
    if (size == 0) return kDataLength;
    for (size_t at = 0; at < size;) {
        const Row* row = row_at(address + at);
        if (row == nullptr || !row->writable) return kAccess;
        if (row->address != address + at || at + row->size > size) return kDataLength;
        at += row->size;
    }
    for (size_t at = 0; at < size;) {
        const Row& row = *row_at(address + at);
        const uint32_t value = little_endian(data + at, row.size);
        if (value < row.low || value > row.high) return kDataRange;
        at += row.size;
    }
    return kNone;
}

Error Node::write(uint16_t address, const uint8_t* data, size_t size) {
    const Error error = judge(address, data, size);
    if (error != kNone) return error;
    std::memcpy(bytes_.data() + address, data, size);
    is_kept_stale_ = is_kept_stale_ || address < page::kKeptStop;
    return kNone;
}

Error Node::prepare(uint16_t address, const uint8_t* data, size_t size) {
    const Error error = judge(address, data, size);
    if (error != kNone) return error;
    std::memcpy(prepared_.data(), data, size);
    prepared_address_ = address;
    prepared_size_ = size;
    bytes_[page::kRegisteredInstruction] = 1;
    return kNone;
}

Error Node::act() {
    if (prepared_size_ == 0) return kInstruction;
    const size_t size = prepared_size_;
    prepared_size_ = 0;
    bytes_[page::kRegisteredInstruction] = 0;
    return write(prepared_address_, prepared_.data(), size);
}

void Node::reset(bool keep_id, bool keep_baud) {
    const uint8_t id = bytes_[page::kId], baud = bytes_[page::kBaudRate];
    initialise(0);
    if (keep_id) bytes_[page::kId] = id;
    if (keep_baud) bytes_[page::kBaudRate] = baud;
    is_kept_stale_ = true;
}

void Node::settle() {
    if (!is_kept_stale_) return;
    is_kept_stale_ = false;
    std::array<uint8_t, sizeof kKept + 2> kept{kKeptMark};
    for (size_t at = 0; at < sizeof kKept; ++at) kept[at + 1] = bytes_[kKept[at]];
    kept.back() = check_of(kept.data(), kept.size() - 1);
    store_.save(kept.data(), kept.size());
}

void Node::describe_chip(uint8_t who_am_i, uint16_t filter_delay_us, uint16_t period_us) {
    bytes_[page::kWhoAmI] = who_am_i;
    store(page::kFilterDelay, filter_delay_us, 2);
    store(page::kSamplePeriod, period_us, 2);
}

void Node::take(const Sample& sample, uint32_t time_us, bool is_fresh) {
    const uint32_t period = count(page::kSamplePeriod, 2);
    ++taken_since_;
    if (is_fresh) {
        const uint32_t made = has_timed_ && period > 0 ? (time_us - timed_us_ + period / 2) / period : 0;
        if (made > taken_since_) store(page::kLostSamples, count(page::kLostSamples, 4) + made - taken_since_, 4);
        has_timed_ = true;
        timed_us_ = time_us;
        taken_since_ = 0;
    }
    for (uint16_t axis = 0; axis < 3; ++axis) {
        const auto step = static_cast<uint16_t>(2 * axis);
        store(page::kGyroX + step, static_cast<uint16_t>(sample.gyro[axis]), 2);
        store(page::kAccelerationX + step, static_cast<uint16_t>(sample.acceleration[axis]), 2);
    }
    const float x = sample.acceleration[0], y = sample.acceleration[1], z = sample.acceleration[2];
    store(page::kRoll, static_cast<uint16_t>(tenth_degrees(std::atan2(y, z))), 2);
    store(page::kPitch, static_cast<uint16_t>(tenth_degrees(std::atan2(-x, std::hypot(y, z)))), 2);
    store(page::kSampleTime, time_us, 4);
    store(page::kSamples, count(page::kSamples, 4) + 1, 4);
}

void Node::report_chip(bool works) { bytes_[page::kHardwareErrorStatus] = works ? 0 : kSensorError; }

void Node::store(uint16_t address, uint32_t value, uint8_t size) {
    for (uint8_t at = 0; at < size; ++at) bytes_[address + at] = static_cast<uint8_t>(value >> (8 * at));
}

uint32_t Node::count(uint16_t address, uint8_t size) const { return little_endian(bytes_.data() + address, size); }

}  // namespace sinew
