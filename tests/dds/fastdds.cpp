// eProsima Fast DDS for `peer.py`, which loads this as a library: samples pass as bytes, with their
// encapsulation, so that it writes what no proper type support would ever send. UDP on the loopback
// interface alone, without multicast, as Cyclone DDS does in `peer.py`.

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstring>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/dds/log/StdoutErrConsumer.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

using namespace eprosima::fastdds::dds;
using namespace eprosima::fastrtps::rtps;
using eprosima::fastdds::rtps::UDPv4TransportDescriptor;
using eprosima::fastrtps::types::ReturnCode_t;

namespace {

using Bytes = std::vector<uint8_t>;

// Every type: only its name matters.
class Opaque : public TopicDataType {
public:
    explicit Opaque(const char* name) {
        setName(name);
        m_typeSize = 1024;  // A start; it grows with the sample.
        auto_fill_type_object(false);
        auto_fill_type_information(false);
    }

    bool serialize(void* data, SerializedPayload_t* payload) override {
        const Bytes& bytes = *static_cast<Bytes*>(data);
        if (bytes.size() > payload->max_size) {
            return false;
        }
        std::memcpy(payload->data, bytes.data(), bytes.size());
        payload->length = bytes.size();
        payload->encapsulation = CDR_LE;
        return true;
    }

    bool deserialize(SerializedPayload_t* payload, void* data) override {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }

    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }

    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

struct Received {
    uint32_t number = 0;
    Bytes bytes;
    // The sample to which it replies.
    SampleIdentity related;
    // Its own.
    SampleIdentity identity;
};

struct Participant {
    DomainParticipant* dds = nullptr;
    Publisher* publisher = nullptr;
    Subscriber* subscriber = nullptr;
    std::vector<std::unique_ptr<DataReaderListener>> listeners;
    std::mutex lock;
    std::condition_variable news;
    std::deque<Received> received;
    Received taken;
};

// Takes what a reader has into the one queue.
class QueueListener : public DataReaderListener {
public:
    QueueListener(Participant* owner, uint32_t number) : owner_(owner), number_(number) {}

    void on_data_available(DataReader* reader) override {
        Bytes bytes;
        SampleInfo info;
        while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
            if (info.valid_data) {
                std::lock_guard<std::mutex> guard(owner_->lock);
                owner_->received.push_back({number_, std::move(bytes), info.related_sample_identity,
                                             info.sample_identity});
                owner_->news.notify_one();
            }
        }
    }

private:
    Participant* owner_;
    uint32_t number_;
};

void put(const GUID_t& id, uint8_t* bytes) {
    std::memcpy(bytes, id.guidPrefix.value, 12);
    std::memcpy(bytes + 12, id.entityId.value, 4);
}

template <class Qos>
void set(Qos& qos, bool reliable, bool transient_local, int32_t depth) {
    qos.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    qos.reliability().max_blocking_time = {10, 0};
    qos.durability().kind = transient_local ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    qos.history().kind = KEEP_LAST_HISTORY_QOS;
    qos.history().depth = depth;
    qos.resource_limits() = ResourceLimitsQosPolicy();
    qos.resource_limits().max_samples = 0;
    qos.resource_limits().max_instances = 0;
    qos.resource_limits().max_samples_per_instance = 0;
    qos.endpoint().history_memory_policy = PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    qos.data_sharing().off();
}

Topic* make_topic(Participant* participant, const char* topic, const char* type) {
    TypeSupport(new Opaque(type)).register_type(participant->dds);
    return participant->dds->create_topic(topic, type, TOPIC_QOS_DEFAULT);
}

}  // namespace

// Nothing of it is to be had where a null pointer or a false is returned.
extern "C" {

Participant* fast_open(uint32_t domain, int32_t lease_ms, int32_t announce_ms) {
    // Standard output belongs to the answers of `peer.py`.
    Log::ClearConsumers();
    Log::RegisterConsumer(std::make_unique<StdoutErrConsumer>());
    DomainParticipantQos qos;
    auto udp = std::make_shared<UDPv4TransportDescriptor>();
    udp->interfaceWhiteList.push_back("127.0.0.1");
    udp->maxInitialPeersRange = 30;
    udp->sendBufferSize = udp->receiveBufferSize = 4 << 20;
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(udp);
    // Its own ports and those of its peers are counted up from the well-known ones.
    Locator_t loopback;
    IPLocator::setIPv4(loopback, "127.0.0.1");
    auto& builtin = qos.wire_protocol().builtin;
    builtin.metatrafficUnicastLocatorList.push_back(loopback);
    builtin.initialPeersList.push_back(loopback);
    auto& discovery = builtin.discovery_config;
    discovery.leaseDuration = {lease_ms / 1000, uint32_t(lease_ms % 1000) * 1000000u};
    discovery.leaseDuration_announcementperiod = {announce_ms / 1000, uint32_t(announce_ms % 1000) * 1000000u};
    auto participant = std::make_unique<Participant>();
    participant->dds = DomainParticipantFactory::get_instance()->create_participant(domain, qos);
    if (participant->dds == nullptr) {
        return nullptr;
    }
    participant->publisher = participant->dds->create_publisher(PUBLISHER_QOS_DEFAULT);
    participant->subscriber = participant->dds->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    return participant.release();
}

// 16 bytes.
void fast_guid(Participant* participant, uint8_t* guid) {
    put(participant->dds->guid(), guid);
}

DataWriter* fast_writer(Participant* participant, const char* topic, const char* type, bool reliable,
                        bool transient_local, int32_t depth) {
    DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
    set(qos, reliable, transient_local, depth);
    Topic* made = make_topic(participant, topic, type);
    return made == nullptr ? nullptr : participant->publisher->create_datawriter(made, qos);
}

bool fast_write(DataWriter* writer, const uint8_t* data, size_t size, int64_t stamp_ns) {
    Bytes bytes(data, data + size);
    eprosima::fastrtps::Time_t stamp{int32_t(stamp_ns / 1000000000), uint32_t(stamp_ns % 1000000000)};
    return writer->write_w_timestamp(&bytes, HANDLE_NIL, stamp) == ReturnCode_t::RETCODE_OK;
}

int32_t fast_matched(DataWriter* writer) {
    PublicationMatchedStatus status;
    writer->get_publication_matched_status(status);
    return status.current_count;
}

int32_t fast_writers(DataReader* reader) {
    SubscriptionMatchedStatus status;
    reader->get_subscription_matched_status(status);
    return status.current_count;
}

int32_t fast_complaints(DataWriter* writer) {
    OfferedIncompatibleQosStatus status;
    writer->get_offered_incompatible_qos_status(status);
    return status.total_count;
}

bool fast_acknowledged(DataWriter* writer, int32_t seconds) {
    return writer->wait_for_acknowledgments({seconds, 0}) == ReturnCode_t::RETCODE_OK;
}

// What it receives is queued under this number.
DataReader* fast_reader(Participant* participant, uint32_t number, const char* topic, const char* type,
                 bool reliable, bool transient_local, int32_t depth) {
    DataReaderQos qos = DATAREADER_QOS_DEFAULT;
    set(qos, reliable, transient_local, depth);
    Topic* made = make_topic(participant, topic, type);
    participant->listeners.push_back(std::make_unique<QueueListener>(participant, number));
    return made == nullptr ? nullptr : participant->subscriber->create_datareader(
                                           made, qos, participant->listeners.back().get());
}

// Waits for a sample; its bytes stay until the next call.
const uint8_t* fast_take(Participant* participant, int32_t wait_ms, uint32_t* number, size_t* size) {
    std::unique_lock<std::mutex> guard(participant->lock);
    auto there = [participant] { return !participant->received.empty(); };
    if (!participant->news.wait_for(guard, std::chrono::milliseconds(wait_ms), there)) {
        return nullptr;
    }
    participant->taken = std::move(participant->received.front());
    participant->received.pop_front();
    *number = participant->taken.number;
    *size = participant->taken.bytes.size();
    return participant->taken.bytes.data();
}

// 16 bytes of the writer or reader to which the taken sample replies, and its number there.
int64_t fast_related(Participant* participant, uint8_t* guid) {
    put(participant->taken.related.writer_guid(), guid);
    return participant->taken.related.sequence_number().to64long();
}

// Writes a request as rmw_fastrtps does. With `reader` it names its own reader of replies, as newer versions
// do; `guid` gets the 16 bytes by which it knows the reply. Returns its number, 0 if it fails.
int64_t fast_request(DataWriter* writer, DataReader* reader, const uint8_t* data, size_t size, uint8_t* guid) {
    Bytes bytes(data, data + size);
    WriteParams params;
    if (reader != nullptr) {
        params.related_sample_identity().writer_guid() = reader->guid();
    }
    if (!writer->write(&bytes, params)) {
        return 0;
    }
    put(reader != nullptr ? reader->guid() : writer->guid(), guid);
    return params.sample_identity().sequence_number().to64long();
}

// 16 bytes of the client to which rmw_fastrtps sends the reply to the taken request, and the number of the request.
int64_t fast_asked(Participant* participant, uint8_t* guid) {
    const auto& taken = participant->taken;
    bool names_its_reader = taken.related.writer_guid() != GUID_t::unknown();
    put(names_its_reader ? taken.related.writer_guid() : taken.identity.writer_guid(), guid);
    return taken.identity.sequence_number().to64long();
}

bool fast_reply(DataWriter* writer, const uint8_t* data, size_t size, const uint8_t* guid, int64_t sequence) {
    Bytes bytes(data, data + size);
    WriteParams params;
    GUID_t client;
    std::memcpy(client.guidPrefix.value, guid, 12);
    std::memcpy(client.entityId.value, guid + 12, 4);
    params.related_sample_identity().writer_guid() = client;
    params.related_sample_identity().sequence_number() = SequenceNumber_t(int32_t(sequence >> 32), uint32_t(sequence));
    return writer->write(&bytes, params);
}

// Says goodbye.
void fast_close(Participant* participant) {
    participant->dds->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(participant->dds);
    delete participant;
}

}  // extern "C"
