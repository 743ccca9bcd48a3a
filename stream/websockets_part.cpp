// The part `websockets`.
#include "core/load_part.hpp"
#include "stream/websockets_functions.hpp"

TWINRATE_PART const twinrate::WebsocketsFunctions twinrate_part;
const twinrate::WebsocketsFunctions twinrate_part = {
    .create_context = lws_create_context,
    .destroy_context = lws_context_destroy,
    .context_user = lws_context_user,
    .context_of = lws_get_context,
    .vhost = lws_get_vhost_by_name,
    .listen_port = lws_get_vhost_listen_port,
    .serve = lws_service,
    .call_when_writable = lws_callback_on_writable,
    .is_choked = lws_send_pipe_choked,
    .write = lws_write,
    .is_final_fragment = lws_is_final_fragment,
    .bytes_to_come = lws_remaining_packet_payload,
    .log_level = lws_set_log_level,
};
