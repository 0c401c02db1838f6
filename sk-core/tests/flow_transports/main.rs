//! One suite of rules for every transport of the flow: real sockets, real pseudo-terminals, nothing simulated.
//!
//! A rule that a transport cannot have is left out where the tests are made, with the reason beside it.

mod garbage;
mod line_rules;
mod network;
mod plug;
mod rules;
mod socket;
mod supply;
#[cfg(feature = "tls")]
mod trust_rules;
mod udp_rules;
mod wire;

/// Makes one test of each rule for one transport.
macro_rules! conforms {
    ($transport:ident: $kind:expr; $($rule:ident),+ $(,)?) => {
        mod $transport {
            $(
                #[test]
                fn $rule() {
                    crate::rules::$rule($kind);
                }
            )+
        }
    };
}

conforms! { tcp: crate::network::Kind::Tcp;
    messages_small_and_large_arrive_intact,
    a_light_channel_is_not_kept_waiting_by_a_heavy_one,
    an_end_at_any_moment_leaves_the_others_undisturbed,
    garbage_is_killed_and_the_others_live_on,
    a_peer_that_does_not_read_costs_a_bounded_amount,
    a_satellite_that_lost_its_hub_restores_channels_and_subscriptions,
    a_silent_peer_is_closed_and_the_others_stay,
}

conforms! { unix: crate::network::Kind::Unix;
    messages_small_and_large_arrive_intact,
    a_light_channel_is_not_kept_waiting_by_a_heavy_one,
    an_end_at_any_moment_leaves_the_others_undisturbed,
    garbage_is_killed_and_the_others_live_on,
    a_peer_that_does_not_read_costs_a_bounded_amount,
    a_satellite_that_lost_its_hub_restores_channels_and_subscriptions,
    a_silent_peer_is_closed_and_the_others_stay,
}

// A pipe has no bytes that could be garbage, its hub is in the same process and never comes back, and both of its
// ends are of this library: silence shows as the end of its queue.
conforms! { pipe: crate::network::Kind::Pipe;
    messages_small_and_large_arrive_intact,
    a_light_channel_is_not_kept_waiting_by_a_heavy_one,
    an_end_in_any_round_leaves_the_others_undisturbed,
}

// A line has no connections of its own that could be cut, held or filled with garbage: the rules beside this suite
// say what holds when that befalls the whole of it.
conforms! { tty: crate::network::Kind::Tty;
    messages_small_and_large_arrive_intact,
    a_light_channel_is_not_kept_waiting_by_a_heavy_one,
    an_end_in_any_round_leaves_the_others_undisturbed,
    a_satellite_that_lost_its_hub_restores_channels_and_subscriptions,
}

#[cfg(feature = "websocket")]
conforms! { websocket: crate::network::Kind::WebSocket;
    messages_small_and_large_arrive_intact,
    a_light_channel_is_not_kept_waiting_by_a_heavy_one,
    an_end_at_any_moment_leaves_the_others_undisturbed,
    garbage_is_killed_and_the_others_live_on,
    a_peer_that_does_not_read_costs_a_bounded_amount,
    a_satellite_that_lost_its_hub_restores_channels_and_subscriptions,
    a_silent_peer_is_closed_and_the_others_stay,
}

#[cfg(feature = "tls")]
conforms! { tls: crate::network::Kind::Tls;
    messages_small_and_large_arrive_intact,
    a_light_channel_is_not_kept_waiting_by_a_heavy_one,
    an_end_at_any_moment_leaves_the_others_undisturbed,
    garbage_is_killed_and_the_others_live_on,
    a_peer_that_does_not_read_costs_a_bounded_amount,
    a_satellite_that_lost_its_hub_restores_channels_and_subscriptions,
    a_silent_peer_is_closed_and_the_others_stay,
}

#[cfg(all(feature = "tls", feature = "websocket"))]
conforms! { secure_websocket: crate::network::Kind::SecureWebSocket;
    messages_small_and_large_arrive_intact,
    a_light_channel_is_not_kept_waiting_by_a_heavy_one,
    an_end_at_any_moment_leaves_the_others_undisturbed,
    garbage_is_killed_and_the_others_live_on,
    a_peer_that_does_not_read_costs_a_bounded_amount,
    a_satellite_that_lost_its_hub_restores_channels_and_subscriptions,
    a_silent_peer_is_closed_and_the_others_stay,
}

/// Publishing by UDP beside the connection that it was opened over.
mod udp {
    use crate::network::Kind;
    use crate::udp_rules as rules;

    #[test]
    fn messages_small_and_large_arrive_intact() {
        [Kind::Tcp, Kind::Unix, Kind::Pipe]
            .into_iter()
            .for_each(rules::messages_small_and_large_arrive_intact);
    }

    #[test]
    fn a_satellite_that_lost_its_hub_publishes_by_datagram_again() {
        let kinds = [Kind::Tcp, Kind::Unix];
        kinds
            .into_iter()
            .for_each(rules::a_satellite_that_lost_its_hub_publishes_by_datagram_again);
    }

    #[test]
    fn t15_strangers_get_no_byte() {
        rules::strangers_get_no_byte(Kind::Tcp);
    }
}
